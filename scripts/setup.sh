# Sourced by scripts/demo and scripts/test: brings what is missing, says what it does, costs nothing when run again.
# vsx_setup [dev]  sets VSX_PYTHON and PYTHONPATH.

vsx_say() { printf '[setup] %s\n' "$*" >&2; }
vsx_die() { printf '[setup] %s\n' "$*" >&2; exit 1; }

vsx_list() { sed -e 's/#.*//' -e '/^[[:space:]]*$/d' "$1"; }

vsx_system_packages() {
    command -v dpkg-query >/dev/null || vsx_die "This needs Debian 12/13 or Ubuntu 22.04 (apt): no dpkg here. On another system, use a container of one of them."
    local missing=() package
    local installed lists=("$root/apt.txt")
    [ "${1:-}" = dev ] && lists+=("$root/apt-dev.txt")
    [ "$(uname -m)" = x86_64 ] || lists+=("$root/apt-compile.txt")
    installed=$(dpkg-query -W -f '${Package} ${Status}\n' 2>/dev/null | sed -n 's/ install ok installed$//p')
    for package in $(for list in "${lists[@]}"; do vsx_list "$list"; done); do
        grep -qxF "$package" <<<"$installed" || missing+=("$package")
    done
    [ ${#missing[@]} -eq 0 ] && return 0
    local sudo=()
    if [ "$(id -u)" -ne 0 ]; then
        command -v sudo >/dev/null || vsx_die "ROS packages are missing and neither root nor sudo is at hand. As root, run: apt-get install --no-install-recommends ${missing[*]}"
        sudo=(sudo)
    fi
    vsx_say "installing ${#missing[@]} system packages (up to 500 MB on disk, half a minute to two): ${missing[*]}"
    "${sudo[@]}" apt-get update -qq || vsx_say "apt-get update reported a problem; trying with the lists at hand"
    "${sudo[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null ||
        vsx_die "apt-get could not install: ${missing[*]}. Look at its message above; 'apt-get update' and the archive's universe section (Ubuntu) are the usual remedies; Ubuntu 24.04 carries no ROS 1, there use a container of Debian 12."
}

# What only some tests use: they skip where it is missing, so nothing here ends the setup.
vsx_optional_packages() {
    local missing=() package
    for package in $(vsx_list "$root/apt-optional.txt"); do
        dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -qF 'ok installed' && continue
        if apt-cache show "$package" >/dev/null 2>&1; then missing+=("$package"); fi
    done
    [ ${#missing[@]} -eq 0 ] && return 0
    if [ "$(id -u)" -ne 0 ]; then
        vsx_say "tests that need them will skip: ${missing[*]} (sudo apt-get install --no-install-recommends ${missing[*]})"
        return 0
    fi
    vsx_say "installing what some tests show things with (up to 1.2 GB on disk, one minute or two): ${missing[*]}"
    DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null ||
        vsx_say "apt-get could not install them; the tests that need them will skip"
}

vsx_pip() {
    "$VSX_PYTHON" -m pip install -q --disable-pip-version-check "$@" >"$venv/vsx-setup.log" 2>&1 && return 0
    tail -n 20 "$venv/vsx-setup.log" >&2
    vsx_die "pip could not install $*; its last words are above. The usual reasons: no network, a certificate or proxy pip does not know (pip config list), a full disk (df -h)."
}

vsx_python_packages() {
    local files=("$root/requirements.txt") stamp
    [ "${1:-}" = dev ] && files+=("$root/requirements-dev.txt")
    stamp=$({ cat "${files[@]}" "$root/setup.py"; /usr/bin/python3 --version; echo "$root"; } | sha256sum | cut -d' ' -f1)
    VSX_PYTHON="$venv/bin/python3"
    if [ -x "$VSX_PYTHON" ] && grep -qsxF "$stamp" "$venv/vsx-setup.stamp"; then return 0; fi
    if ! "$VSX_PYTHON" -c 'import rospy' 2>/dev/null; then
        vsx_say "making the Python environment $venv"
        /usr/bin/python3 -m venv --clear --system-site-packages "$venv" || vsx_die "could not make the environment $venv; set VSX_VENV to a directory you may write to."
    fi
    vsx_say "installing Python packages (650 MB on disk, under a minute)"
    local requirements=()
    local file; for file in "${files[@]}"; do requirements+=(-r "$file"); done
    vsx_pip "${requirements[@]}"
    vsx_pip --no-deps --no-build-isolation -e "$root"
    echo "$stamp" >>"$venv/vsx-setup.stamp"
}

vsx_kernels() {
    "$VSX_PYTHON" -m vsx_ros.cli.compiled && return 0
    vsx_say "compiling the kernels (once for a checkout, a minute or two; longer on a slow machine)"
    local trial; trial=$(mktemp -d)
    "$VSX_PYTHON" -m vsx_ros.cli.main explore --fast --time 8 --out "$trial/run" >"$trial/log" 2>&1 ||
        { tail -n 20 "$trial/log" >&2; vsx_die "the kernels did not compile; the last words are above."; }
    rm -rf "$trial"
}

vsx_setup() {
    local started=$SECONDS
    root=$(cd "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")/.." && pwd)
    venv=${VSX_VENV:-${XDG_DATA_HOME:-$HOME/.local/share}/vsx_ros/venv}
    vsx_system_packages "${1:-}"
    [ "${1:-}" != dev ] || vsx_optional_packages
    vsx_python_packages "$@"
    export VSX_PYTHON PYTHONPATH="$root/src:$root/hw${PYTHONPATH:+:$PYTHONPATH}"
    export ROS_PACKAGE_PATH="$root${ROS_PACKAGE_PATH:+:$ROS_PACKAGE_PATH}:/usr/share"
    vsx_kernels
    vsx_say "ready after $((SECONDS - started)) s"
}
