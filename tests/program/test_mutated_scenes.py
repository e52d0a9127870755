"""Spoilt scenes through the program: accepted or refused, never worse."""

from __future__ import annotations

import random
import re

from tests.conftest import SMALL_SCENE

SEED = 20161121
SCENE = SMALL_SCENE + 8 * "! a comment, where most of what is changed does no harm\n"
PIECES = [*"/&'=,()-*%!", "1e400", "nan", "-1", "0", "é"]
PLACE = re.compile(r"mutated\.nml(:\d+: .+|: must have &process, &chain or &structure)")


def spoilt(text: str, dice: random.Random) -> str:
    """One to three changes: a character replaced, a piece cut out, doubled or put in."""
    for _ in range(dice.randint(1, 3)):
        first = dice.randrange(len(text))
        last = first + dice.randint(1, 12)
        change = dice.randrange(4)
        if change == 0:
            text = text[:first] + chr(dice.randrange(256)) + text[first + 1 :]
        elif change == 1:
            text = text[:first] + text[last:]
        elif change == 2:
            text = text[:last] + text[first:]
        else:
            text = text[:first] + dice.choice(PIECES) + text[first:]
    return text


def test_a_spoilt_scene_is_accepted_or_refused(entroslip, tmp_path):
    print(f"seed {SEED}")
    dice = random.Random(SEED)
    path = tmp_path / "mutated.nml"
    outcomes = {0: 0, 2: 0}
    for number in range(200):
        text = spoilt(SCENE, dice)
        path.write_text(text, encoding="utf-8", newline="")
        done = entroslip("check", path, timeout=60)
        assert done.returncode in outcomes, f"{number}: {done.returncode}\n{text}\n{done.stderr}"
        outcomes[done.returncode] += 1
        if done.returncode == 2:
            assert PLACE.search(done.stderr), f"{number}:\n{text}\n{done.stderr}"
            if number % 10 == 0:
                assert entroslip("run", path, timeout=60).returncode == 2
        assert [p.name for p in tmp_path.iterdir()] == ["mutated.nml"]
    assert min(outcomes.values()) > 10  # both ends were seen
