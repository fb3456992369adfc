#!/bin/sh
# Sets up coulomb: Debian's packages that are missing, a virtual environment .venv that sees them, and coulomb in it.  On
# another Linux whose python3 has no DOLFINx: PyPI's DOLFINx and MPICH in .venv, without root.
# Run it as often as you like: with nothing to do it returns at once.  PYTHON=... chooses another Python with DOLFINx.
#   ./install.sh --pip ...    PyPI's DOLFINx on Debian too (or with PYTHON=..., 3.12 or newer); before any other option
#   ./install.sh              everything, the tools for tests and documentation too
#   ./install.sh --plain      without these tools: runs, pictures, films and reports
#   ./install.sh --cluster    without pictures, films and reports as well: runs, certificates, files for ParaView
#   ./install.sh --packages   Debian's packages, and no more (for images in layers)
set -eu
cd "$(dirname "$0")"

say() { printf 'install.sh: %s\n' "$*"; }
die() { printf 'install.sh: %s\n' "$*" >&2; exit 1; }
pip=
[ "${1:-}" != --pip ] || { pip=yes; shift; }
case "${1:-}" in
    "") extras='[pictures,video,test,docs]' ;;
    --plain | --packages) extras='[pictures,video]' ;;
    --cluster) extras= ;;
    *) die "unknown option $1: there are --pip, --plain, --cluster and --packages" ;;
esac
installed() { dpkg-query -W -f '${Status}\n' "$@" 2>/dev/null | grep -c '^install ok installed$' || true; }

# --- 1. the platform ---------------------------------------------------------------------------------------------
# DOLFINx with real numbers, what it needs to compile its forms, MPI, OpenBLAS (with the reference BLAS, sparse
# factorisations are 2 to 8 times slower), and a way to draw without a display (OSMesa, or EGL where OSMesa is gone).
needed="python3-dolfinx-real python3-petsc4py-real python3-mpi4py python3-numpy python3-scipy python3-h5py
        python3-venv python3-dev gcc libc6-dev mpi-default-bin libopenblas0-pthread"

drawing() { [ -z "$extras" ] || [ "$(installed libosmesa6)" = 1 ] || [ "$(installed libegl1 libgl1-mesa-dri)" = 2 ]; }

debian_packages() {
    # shellcheck disable=SC2086  # the list is meant to be split
    set -- $needed
    if [ "$(installed "$@")" = $# ] && drawing; then return; fi
    as_root=
    if [ "$(id -u)" != 0 ]; then
        command -v sudo >/dev/null || die "not root and no sudo: ask for these packages to be installed: $* libosmesa6"
        as_root=sudo
    fi
    say "installing what is missing of: $*"
    # An automatic upgrade after the start of a machine, or another install.sh, holds apt's locks for minutes.  `install` can
    # wait for them, `update` cannot.
    left=600
    until why=$($as_root env LC_ALL=C apt-get update -q 2>&1); do
        case $why in *"Could not get lock"*) ;; *) left=0 ;; esac
        [ "$left" -gt 0 ] || die "$why"
        left=$((left - 5))
        sleep 5
    done
    if ! drawing; then
        if apt-cache show libosmesa6 >/dev/null 2>&1; then set -- "$@" libosmesa6
        else set -- "$@" libegl1 libgl1-mesa-dri; fi
    fi
    $as_root env DEBIAN_FRONTEND=noninteractive apt-get install -q -y --no-install-recommends \
        -o DPkg::Lock::Timeout=600 "$@"
}

can_import() { "$1" -c 'import numpy, scipy, h5py, mpi4py.MPI, petsc4py.PETSc, dolfinx'; }

python_for_wheel() {  # one that the wheel of DOLFINx is for
    [ "$(uname -sm)" = "Linux x86_64" ] || die "PyPI has DOLFINx for Linux on x86_64 only: install it from conda-forge"
    libc=$(getconf GNU_LIBC_VERSION 2>/dev/null | cut -d ' ' -f 2)
    [ "$(printf '2.34\n%s\n' "${libc:-0}" | sort -V | head -n 1)" = 2.34 ] ||
        die "PyPI's DOLFINx needs glibc 2.34 or newer, here it is ${libc:-another C library}: install it from conda-forge"
    command -v "${CC:-cc}" >/dev/null || say "no C compiler: DOLFINx needs one, such as gcc, when coulomb first runs" >&2
    for python in ${PYTHON:-python3.14 python3.13 python3.12 python3}; do
        if "$python" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 12))' 2>/dev/null; then return; fi
    done
    die "PyPI's DOLFINx needs Python 3.12 or newer with venv: none found (${PYTHON:-python3.12 to python3.14, python3})"
}

if [ -n "$pip" ]; then
    python_for_wheel
elif [ -n "${PYTHON:-}" ]; then
    python=$PYTHON
elif grep -qs '^ID=debian$' /etc/os-release; then
    major=$(sed -n 's/^VERSION_ID="\{0,1\}\([0-9]*\).*/\1/p' /etc/os-release)
    [ "${major:-99}" -ge 12 ] || die "Debian $major is too old: its DOLFINx is older than 0.5; Debian 12 or newer is needed"
    debian_packages
    python=/usr/bin/python3          # Debian's own: another python3 on the PATH does not see Debian's DOLFINx
else
    python=$(command -v python3) || die "no python3 found"
    if ! can_import "$python" 2>/dev/null; then
        say "$python has no DOLFINx: taking PyPI's, as with --pip"
        pip=yes
        python_for_wheel
    fi
fi
[ "${1:-}" != --packages ] || exit 0
if [ -n "$pip" ]; then
    if [ -n "$extras" ]; then extras="[fenicsx,${extras#[}"; else extras='[fenicsx]'; fi
elif ! why=$(can_import "$python" 2>&1); then
    printf '%s\n' "$why" >&2
    [ -z "${PETSC_DIR:-}" ] || say "PETSC_DIR is set ($PETSC_DIR): Debian's DOLFINx then looks for PETSc there; unset it" >&2
    die "$python cannot import what coulomb needs: DOLFINx 0.5 to 0.11 with real numbers, petsc4py, mpi4py, numpy, scipy
and h5py. Debian 12 and 13 have them as packages; elsewhere ./install.sh --pip takes PyPI's, or install DOLFINx first (for
example from conda-forge), activate its environment or name its Python in PYTHON=..., and call this script again."
fi

# --- 2. the virtual environment ----------------------------------------------------------------------------------
stamp="$(cat install.sh pyproject.toml | cksum) $(pwd) $python $("$python" --version) $extras"
if [ -x .venv/bin/coulomb ] && [ "$(cat .venv/installed 2>/dev/null)" = "$stamp" ]; then
    say "nothing to do"
    exit 0
fi
say "making .venv"
rm -f .venv/installed
if [ -n "$pip" ]; then site=; else site=--system-site-packages; fi
"$python" -m venv --clear ${site:+"$site"} .venv || die "python3 -m venv failed: is python3-venv installed?"
# What the platform brings stays as it is: a newer numpy in the environment would break petsc4py.
.venv/bin/python - > .venv/platform.txt <<'PY'
import importlib.metadata as metadata
for name in ("numpy", "scipy", "h5py", "mpi4py", "petsc4py"):
    try:
        print(f"{name}=={metadata.version(name)}")
    except metadata.PackageNotFoundError:
        pass
PY
.venv/bin/python -m pip install --quiet --disable-pip-version-check --constraint .venv/platform.txt --editable ".$extras"
# MMG makes coarser tetrahedra.  Its program alone is taken from mmgpy's wheel, whose Python needs a newer numpy.
{
    .venv/bin/python -m pip download --quiet --disable-pip-version-check --no-deps --only-binary :all: \
        --dest .venv/mmg 'mmgpy>=0.17,<1' &&
        .venv/bin/python -m zipfile -e .venv/mmg/mmgpy-*.whl .venv/mmg && chmod +x .venv/mmg/bin/mmg3d_O3 &&
        rm .venv/mmg/mmgpy-*.whl
} || say "no MMG for this machine: coulomb run --error takes longer for large meshes of tetrahedra"
# Where Python may not write bytecode (PYTHONDONTWRITEBYTECODE), it would compile coulomb at every start: 0.15 s.
.venv/bin/python -m compileall -q coulomb || true
printf '%s' "$stamp" > .venv/installed
say "done: .venv/bin/coulomb"
