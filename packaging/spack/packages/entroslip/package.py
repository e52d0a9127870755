"""Spack recipe of entroslip; builds the checkout that it lies in."""

from contextlib import suppress
from pathlib import Path

from spack.package import *

with suppress(ImportError):  # where Spack 1 has it; before, it came with spack.package
    from spack_repo.builtin.build_systems.cmake import CMakePackage


class Entroslip(CMakePackage):
    """Maximum-entropy models of uncertain properties, and the Monte Carlo vibration of structures
    held by friction."""

    git = f"file://{Path(__file__).resolve().parents[4]}"

    license("MIT")

    version("main", branch="main")

    variant(
        "march",
        default="native",
        values=lambda text: bool(text),
        description="Instruction set, as -march= takes it; x86-64-v3 for mixed clusters",
    )

    depends_on("c", type="build")
    depends_on("fortran", type="build")
    depends_on("cmake@3.25:", type="build")
    depends_on("ninja", type="build")
    depends_on("mpi")
    depends_on("lapack")
    depends_on("fftw@3")
    depends_on("hdf5@1.10: ~mpi +fortran +hl")
    depends_on("nlopt", type="test")
    depends_on("python@3.9:", type="test")

    generator("ninja")

    def cmake_args(self):
        return [
            self.define_from_variant("ENTROSLIP_ARCH", "march"),
            self.define("BUILD_TESTING", self.run_tests),
        ]
