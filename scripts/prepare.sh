# What both commands of the README do first: packages, build, Python. Sourced, not run.
# Each step looks before it acts, so a second run changes nothing.

say() { printf '\n== %s\n' "$*"; }

build_packages="gcc gfortran cmake ninja-build git pkg-config libopenmpi-dev openmpi-bin libopenblas-dev
  libfftw3-dev libhdf5-dev libnlopt-dev python3 python3-venv"

# Tests submit the job scripts to a Slurm of their own, look at the report in a browser, build the Debian package, and
# complete commands in every shell.
test_packages="slurm-wlm munge chromium build-essential debhelper fish zsh"

# install_packages NAME...: whatever is missing, as root or through sudo.
install_packages() {
  local missing=() name as_root=()
  if ! command -v dpkg-query >/dev/null; then
    say "Not a Debian system: taking these packages, or what they are called here, as installed: $*"
    return
  fi
  for name in "$@"; do
    dpkg-query -W -f='${Status}' "$name" 2>/dev/null | grep -q 'ok installed' || missing+=("$name")
  done
  [ ${#missing[@]} -eq 0 ] && return
  if [ "$(id -u)" -ne 0 ]; then
    if ! sudo -n true 2>/dev/null; then
      say "Packages are missing. Run this line, then start again:"
      echo "sudo apt-get update && sudo apt-get install -y --no-install-recommends ${missing[*]}"
      exit 1
    fi
    as_root=(sudo)
  fi
  say "Installing, in a minute or two (build/packages.log): ${missing[*]}"
  mkdir -p build
  { "${as_root[@]}" apt-get update -q &&
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -q \
      --no-install-recommends "${missing[@]}"; } >build/packages.log 2>&1 </dev/null ||
    { tail -n 20 build/packages.log; exit 1; }
}

# build PRESET [TARGET]: configures and builds into build/PRESET, everything or one target.
build() {
  local log=build/configure-$1.log
  say "Building: $1"
  mkdir -p build
  cmake --preset "$1" >"$log" 2>&1 || { cat "$log"; exit 1; }
  cmake --build --preset "$1" ${2:+--target "$2"}
}

# make_venv REQUIREMENTS: .venv with exactly the pinned Python packages, and with the package entroslip as it is here.
make_venv() {
  local stamp=.venv/installed-$(cat "$1" pyproject.toml | sha256sum | cut -c1-16)
  [ -e "$stamp" ] && return
  say "Python packages into .venv"
  python3 -m venv .venv
  # pip would compile all of six thousand files. A fifth of them is imported, and compiled in a tenth of the time.
  local install=(.venv/bin/pip install --quiet --disable-pip-version-check --no-compile)
  "${install[@]}" -r "$1"
  "${install[@]}" --no-deps --editable .
  PYTHONDONTWRITEBYTECODE='' .venv/bin/python -c 'import entroslip.__main__'
  touch "$stamp"
}

# Open MPI: root may run, ranks may share cores.
if [ "$(id -u)" -eq 0 ]; then
  export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
fi
# Its map of the hardware leaves out displays: they are asked for at "localhost", and without that name in /etc/hosts
# each start of a rank waits 5 to 10 s.
export HWLOC_COMPONENTS=-gl
mpi_run=(mpirun --oversubscribe -n)
