# Sourced by scripts/demo and scripts/test: brings what is missing, says what it does, costs nothing when run again.
# vsx_setup [dev]  sets VSX_PYTHON and PYTHONPATH.

vsx_say() { printf '[setup] %s\n' "$*" >&2; }
vsx_die() { printf '[setup] %s\n' "$*" >&2; exit 1; }

# vsx_count WHAT  keeps the newest line of its input in sight, with the seconds; on no terminal every ten of them.
vsx_count() {
    local started=$SECONDS shown=$SECONDS text= line code
    while :; do
        code=0; IFS= read -r -t 1 line || code=$?
        if [ $code -eq 0 ]; then text=" $line,"; elif [ $code -le 128 ]; then break; fi
        if [ -t 2 ]; then printf '\r[setup] %s:%s %d s\033[K' "$1" "$text" $((SECONDS - started)) >&2
        elif ((SECONDS - shown >= 10)); then vsx_say "$1:$text $((SECONDS - started)) s"; shown=$SECONDS; fi
    done
    [ ! -t 2 ] || printf '\r\033[K' >&2
    vsx_say "$1:$text $((SECONDS - started)) s"
}

# vsx_apt_words ALL  says of apt-get's status lines how many of ALL packages are there.
vsx_apt_words() {
    local line done=0
    while IFS= read -r line; do
        case $line in
            dlstatus:*"file "*) echo "file ${line##*file } fetched" ;;
            pmstatus:*":Installed "*) done=$((done + 1)); echo "$done of $1 packages installed" ;;
        esac
    done
}

# vsx_pip_words ALL FOLDER  says of pip's words how many packages, of ALL or more, are there; FOLDER: where pip puts them.
vsx_pip_words() {
    local line found=0 all=0 before=0 code
    while :; do
        code=0; IFS= read -r -t 1 line || code=$?
        [ $code -eq 0 ] || [ $code -gt 128 ] || break
        case $line in
            "Collecting "*) found=$((found + 1)); echo "$found of $1 or more packages fetched" ;;
            "Installing collected packages: "*) all=$(wc -w <<<"${line#*: }"); before=$(vsx_installed "$2") ;;
            "Successfully installed "*) echo "$all of $all packages installed"; all=0 ;;
        esac
        [ $all -eq 0 ] || echo "$(($(vsx_installed "$2") - before)) of $all packages installed"
        line=
    done
}

vsx_installed() { find "$1" -maxdepth 1 -name '*.dist-info' | wc -l; }

# vsx_apt OPTION... PACKAGE...  installs; its words are in $vsx_log.
vsx_apt() {
    local install=(apt-get install -y -q --no-install-recommends "$@") all
    all=$(LC_ALL=C "${install[@]}" -s 2>/dev/null | grep -c '^Inst' || true)
    "${sudo[@]}" env LC_ALL=C DEBIAN_FRONTEND=noninteractive "${install[@]}" -o APT::Status-Fd=1 -o Dpkg::Use-Pty=0 \
        2>&1 | tee "$vsx_log" | vsx_apt_words "$all" | vsx_count apt
}

vsx_list() { sed -e 's/#.*//' -e '/^[[:space:]]*$/d' "$1"; }

vsx_system_packages() {
    [ ! -x /usr/bin/python3 ] || /usr/bin/python3 -c 'import sys; sys.exit(sys.version_info < (3, 10))' ||
        vsx_die "$(/usr/bin/python3 --version) is too old, 3.10 is needed. On Ubuntu 20.04 use a container beside its ROS Noetic: docs/how-to/noetic.md."
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
    sudo=()
    if [ "$(id -u)" -ne 0 ]; then
        command -v sudo >/dev/null || vsx_die "ROS packages are missing and neither root nor sudo is at hand. As root, run: apt-get update && apt-get install --no-install-recommends ${missing[*]}; then run this again"
        sudo=(sudo)
    fi
    vsx_say "installing ${#missing[@]} system packages and what they need (up to 500 MB on disk): ${missing[*]}"
    "${sudo[@]}" apt-get update -q 2>&1 | tee "$vsx_log" | sed -u -n 's/^Get:\([0-9]*\).*/\1 fetched/p' | vsx_count "apt, lists of packages" ||
        vsx_say "apt-get update reported a problem; trying with the lists at hand"
    vsx_apt "${missing[@]}" || {
        tail -n 20 "$vsx_log" >&2
        vsx_die "apt-get could not install: ${missing[*]}. Look at its message above; 'apt-get update' and the archive's universe section (Ubuntu) are the usual remedies; Ubuntu 24.04 carries no ROS 1, there use a container of Debian 12."
    }
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
    vsx_say "installing what some tests use (up to 1.2 GB on disk): ${missing[*]}"
    sudo=()
    vsx_apt "${missing[@]}" ||
        vsx_say "apt-get could not install them; the tests that need them will skip"
}

# Bytecode is left to the first import: most modules are never imported.
vsx_pip() {
    local all packages
    all=$(cat "${files[@]}" | sed -n 's/^\([A-Za-z][^ =;]*\).*/\1/p' | sort -u | wc -l)
    packages=$("$VSX_PYTHON" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')
    PYTHONUNBUFFERED=1 "$VSX_PYTHON" -m pip install --no-compile --progress-bar off --disable-pip-version-check "$@" \
        2>&1 | tee "$vsx_log" | vsx_pip_words "$all" "$packages" | vsx_count pip && return 0
    tail -n 20 "$vsx_log" >&2
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
    vsx_say "installing Python packages (650 MB on disk)"
    local requirements=()
    local file; for file in "${files[@]}"; do requirements+=(-r "$file"); done
    vsx_pip "${requirements[@]}"
    vsx_pip --no-deps --no-build-isolation -e "$root"
    echo "$stamp" >>"$venv/vsx-setup.stamp"
}

vsx_setup() {
    local started=$SECONDS
    root=$(cd "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")/.." && pwd)
    venv=${VSX_VENV:-${XDG_DATA_HOME:-$HOME/.local/share}/vsx_ros/venv}
    vsx_log=$(mktemp)
    vsx_system_packages "${1:-}"
    [ "${1:-}" != dev ] || vsx_optional_packages
    vsx_python_packages "$@"
    export VSX_PYTHON PYTHONPATH="$root/src:$root/hw${PYTHONPATH:+:$PYTHONPATH}"
    export ROS_PACKAGE_PATH="$root${ROS_PACKAGE_PATH:+:$ROS_PACKAGE_PATH}:/usr/share"
    rm -f "$vsx_log"
    vsx_say "ready after $((SECONDS - started)) s"
}
