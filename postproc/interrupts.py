"""Imported first by the package: as a command, its imports take a second.

Ctrl-C then ends it as it does later, by the signal and without a traceback (`output.exit_code`).
"""

import signal
import sys

# Python calls a program `-m` while it imports the package of the module that is to run.
_program = "".join(sys.argv[:1])
_is_command = _program == "-m" or _program.endswith("/entroslip-figures")
if _is_command and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)
