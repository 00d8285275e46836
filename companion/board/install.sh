#!/bin/sh
# Installs, upgrades, rolls back and removes the companion on a board. Needs root and Python 3.11 to 3.13; no network.
set -eu

PREFIX=/opt/understory
CONFIG=/etc/understory
STATE=/var/lib/understory
UNIT=understory-companion.service
UNITS=/etc/systemd/system
JOURNAL=/etc/systemd/journald.conf.d
KEY=$CONFIG/vehicle.key
USER_NAME=understory
HERE=$(cd "$(dirname "$(readlink -f "$0")")" && pwd)

usage() {
    cat <<'TEXT'
usage: install.sh [--env FILE] [--key FILE] [--mission FILE] [--python PYTHON] [--force]
       understory-install --replace-key FILE [--force]
       understory-install --rollback [--force]
       understory-install --uninstall [--purge] [--force]

Run install.sh of an unpacked bundle to install or to upgrade; the release before it is kept.
  --env FILE      becomes /etc/understory/companion.env, unless there is one
  --key FILE      becomes /etc/understory/vehicle.key (0600), unless there is one: this vehicle's, of `companion key new`
  --mission FILE  becomes /etc/understory/mission.toml, unless there is one
  --python PYTHON the Python to use (python3)
  --replace-key FILE  becomes /etc/understory/vehicle.key in the place of the one that is there (companion key rotate)
  --rollback      go back to the release before this one; once more to return
  --uninstall     remove the software and the service; --purge also configuration, key, state and user
  --force         although the companion is flying, or does not say that it is not

exit codes: 0 done, 1 failed, 2 wrong usage or a bad file, 3 this computer lacks something
TEXT
}

say() { echo "understory: $*"; }
fail() {
    code=$1
    shift
    echo "understory: $*" >&2
    exit "$code"
}

has_systemd() { [ -d /run/systemd/system ]; }

# --- the service ---

stop_service() { # remembers in $was_running whether to start it again
    was_running=no
    has_systemd || return 0
    case $(systemctl show --property=ActiveState --value "$UNIT") in
    active | reloading) ;;
    activating) # fails and is started again, over and over: nothing to ask
        systemctl stop "$UNIT"
        was_running=yes
        return 0
        ;;
    *) return 0 ;;
    esac
    status=$(systemctl show --property=StatusText --value "$UNIT")
    case $status in
    *"state waiting"* | *"state ready"* | *"state landed"*) ;;
    *) [ "$force" = yes ] || fail 3 "the companion runs and may be flying ($status): land first, or --force" ;;
    esac
    systemctl stop "$UNIT"
    was_running=yes
}

start_service() {
    if ! has_systemd; then
        say "no systemd is running here: the unit is in $UNITS, nothing was started"
        return 0
    fi
    systemctl daemon-reload
    if [ "$was_running" = yes ]; then
        systemctl start "$UNIT" || fail 1 "the service does not start: journalctl -u $UNIT"
        say "the service runs again"
    fi
}

# --- releases ---

link() { # TARGET NAME: replaced in one step, so that there is never none
    ln -sfn "$1" "$2.new"
    mv -T "$2.new" "$2"
}

name_of() { [ -L "$1" ] && basename "$(readlink "$1")"; }

activate() { # RELEASE
    before=$(name_of "$PREFIX/current" || :)
    [ "$before" = "$1" ] || [ -z "$before" ] || link "releases/$before" "$PREFIX/previous"
    mkdir -p "$UNITS" "$JOURNAL" /usr/local/bin /usr/local/sbin
    install -m 0644 "$PREFIX/releases/$1/$UNIT" "$UNITS/$UNIT.new"
    mv "$UNITS/$UNIT.new" "$UNITS/$UNIT"
    link "releases/$1" "$PREFIX/current"
    ln -sfn "$PREFIX/current/bin/companion" /usr/local/bin/companion
    ln -sfn "$PREFIX/current/bin/mission" /usr/local/bin/mission
    ln -sfn "$PREFIX/current/install.sh" /usr/local/sbin/understory-install
}

prune() {
    for old in "$PREFIX"/releases/*; do
        case $(basename "$old") in
        "$(name_of "$PREFIX/current" || :)" | "$(name_of "$PREFIX/previous" || :)") ;;
        *) rm -rf "$old" ;;
        esac
    done
}

check_bundle() {
    [ -f "$HERE/SHA256SUMS" ] || fail 2 "$HERE: no bundle (SHA256SUMS is missing); unpack the archive, run its install.sh"
    (cd "$HERE" && sha256sum --quiet -c SHA256SUMS) || fail 2 "$HERE: the bundle is damaged; copy it again"
}

check_python() {
    command -v "$python" >/dev/null || fail 3 "$python: not found; on Debian and Ubuntu: apt install python3"
    "$python" - <<'PYTHON' || exit 3
import platform, sys
told = f"understory: {sys.executable} is Python {platform.python_version()}, {platform.machine()}"
if not (3, 11) <= sys.version_info[:2] <= (3, 13):
    sys.exit(f"{told}: the bundle has wheels for 3.11, 3.12 and 3.13; --python names another one")
if sys.maxsize < 2**32 or platform.machine() not in ("x86_64", "aarch64"):
    sys.exit(f"{told}, {sys.maxsize.bit_length() + 1} bits: a 64-bit system is needed (x86_64 or aarch64)")
libc, version = platform.libc_ver()
if libc != "glibc" or tuple(map(int, version.split("."))) < (2, 28):
    sys.exit(f"{told}, {libc or 'libc'} {version}: glibc 2.28 or newer is needed")
PYTHON
}

build() { # RELEASE: a virtual environment from the bundle's wheels alone
    target=$PREFIX/releases/$1
    if [ -f "$target/.complete" ]; then
        say "$1 is installed already"
        return 0
    fi
    say "installing $1"
    rm -rf "$target"
    mkdir -p "$PREFIX/releases"
    "$python" -m venv --without-pip "$target" || fail 3 "$python -m venv failed"
    set -- "$HERE"/wheels/pip-*.whl
    bundled_pip=$1
    run_pip() { PYTHONPATH=$bundled_pip "$target/bin/python" -m pip --isolated --no-cache-dir --disable-pip-version-check "$@"; }
    run_pip install --quiet --no-compile --no-index --find-links "$HERE/wheels" \
        --require-hashes -r "$HERE/requirements-board.lock" || fail 1 "the libraries could not be installed"
    # The compiled wheel where there is one for this Python and processor, else the one that is pure Python.
    run_pip install --quiet --no-compile --no-index --find-links "$HERE/wheels" --no-deps \
        "understory-uav==$(cat "$HERE/VERSION")" || fail 1 "the companion could not be installed"
    if ! "$target/bin/companion" --version >/dev/null 2>&1; then
        say "the compiled companion does not run here: installing pure Python"
        run_pip install --quiet --no-compile --no-index --no-deps --force-reinstall \
            "$HERE"/wheels/understory_uav-*-none-any.whl || fail 1 "the companion could not be installed"
    fi
    # The service may not write here. Not the dialects that nobody imports: they would take minutes on a small board.
    "$target/bin/python" -m compileall -q -x '/pymavlink/dialects/|/pymavlink/generator/|/pip/' "$target/lib" ||
        fail 1 "the files could not be compiled"
    for file in install.sh "$UNIT" companion.env journald.conf README.md; do
        cp "$HERE/$file" "$target/"
    done
    chmod -R go+rX,go-w "$target"
    "$target/bin/companion" --version >/dev/null || fail 1 "the installed companion does not run"
    touch "$target/.complete"
}

# --- user and configuration ---

make_user() {
    getent group "$USER_NAME" >/dev/null || groupadd --system "$USER_NAME"
    getent passwd "$USER_NAME" >/dev/null ||
        useradd --system --gid "$USER_NAME" --no-create-home --home-dir "$STATE" --shell /usr/sbin/nologin "$USER_NAME"
    getent group dialout >/dev/null || groupadd --system dialout
    usermod -aG dialout "$USER_NAME"
}

place() { # SOURCE TARGET MODE OWNER: never over what is there
    if [ -e "$2" ]; then
        say "kept $2"
        return 0
    fi
    (umask 077 && cp "$1" "$2.new")
    chown "$4" "$2.new"
    chmod "$3" "$2.new"
    mv "$2.new" "$2"
    say "made $2"
}

number() { # this vehicle's, as systemd reads it: the last, without blanks and quotes; nothing while none is set
    sed -n 's/^[[:blank:]]*UNDERSTORY_ID[[:blank:]]*=//p' "$CONFIG/companion.env" | tail -n 1 | tr -d "\"'[:blank:]\r"
}

check_key() { # FILE RELEASE: copies it to $KEY.new, if it is this vehicle's, as far as the number is set
    (umask 077 && cp "$1" "$KEY.new")
    shown=$("$2/bin/companion" key show-id "$KEY.new") || {
        rm -f "$KEY.new"
        fail 2 "$1: no key file, see above"
    }
    owner=$(echo "$shown" | sed -n 's/^owner *//p')
    number=$(number)
    [ "$owner" = "vehicle ${number:-${owner#vehicle }}" ] || {
        rm -f "$KEY.new"
        fail 2 "$1: is the key file of $owner, and this is vehicle ${number:-1 to 250} ($CONFIG/companion.env)"
    }
}

put_key() { # after check_key; after a power cut it is the one or the other
    chown "$USER_NAME:$USER_NAME" "$KEY.new"
    sync "$KEY.new"
    mv "$KEY.new" "$KEY"
    sync "$CONFIG"
    say "made $KEY, of $owner"
}

configure() {
    mkdir -p "$CONFIG" "$JOURNAL"
    chmod 0755 "$CONFIG"
    place "${env_file:-$HERE/companion.env}" "$CONFIG/companion.env" 0644 root:root
    [ -z "$mission_file" ] || place "$mission_file" "$CONFIG/mission.toml" 0644 root:root
    if [ -n "$key_file" ] && [ -e "$KEY" ]; then
        say "kept $KEY (--replace-key replaces it)"
    elif [ -n "$key_file" ]; then
        check_key "$key_file" "$PREFIX/releases/$release"
        put_key
    fi
    install -d -m 0700 -o "$USER_NAME" -g "$USER_NAME" "$STATE"
    place "$HERE/journald.conf" "$JOURNAL/understory.conf" 0644 root:root
}

next_steps() {
    [ -n "$(number)" ] || say "to do: this vehicle's number in $CONFIG/companion.env"
    [ -e "$CONFIG/mission.toml" ] || say "to do: the swarm's mission as $CONFIG/mission.toml"
    [ -e "$KEY" ] || say "to do: this vehicle's key: understory-install --replace-key FILE"
    if ! has_systemd; then
        say "to do: start it at boot: systemctl enable --now $UNIT"
    elif ! systemctl is-enabled --quiet "$UNIT" 2>/dev/null; then
        systemctl try-restart systemd-journald.service
        say "to do: start it, now and at boot: systemctl enable --now $UNIT"
    fi
}

# --- what is asked ---

do_install() {
    check_bundle
    check_python
    for file in "$env_file" "$mission_file" "$key_file"; do
        [ -z "$file" ] || [ -r "$file" ] || fail 2 "$file: cannot be read"
    done
    release=$(cat "$HERE/VERSION")-$(sha256sum "$HERE/SHA256SUMS" | cut -c 1-8)
    make_user
    build "$release"
    configure
    stop_service
    activate "$release"
    start_service
    prune
    say "release $release is current$(name_of "$PREFIX/previous" | sed 's/.*/, & is kept: understory-install --rollback/')"
    next_steps
}

do_replace_key() {
    [ -r "$key_file" ] || fail 2 "$key_file: cannot be read"
    [ -x "$PREFIX/current/bin/companion" ] || fail 1 "nothing is installed: install.sh --key FILE"
    check_key "$key_file" "$PREFIX/current"
    stop_service
    put_key
    start_service
}

do_rollback() {
    previous=$(name_of "$PREFIX/previous" || :)
    [ -f "$PREFIX/releases/${previous:-none}/.complete" ] || fail 1 "there is no release to go back to"
    stop_service
    activate "$previous"
    start_service
    say "release $previous is current, $(name_of "$PREFIX/previous") is kept: understory-install --rollback"
}

do_uninstall() {
    stop_service
    if command -v systemctl >/dev/null; then
        systemctl --quiet disable "$UNIT" 2>/dev/null || :
    fi
    rm -f "$UNITS/$UNIT" "$JOURNAL/understory.conf" /usr/local/bin/companion /usr/local/bin/mission
    rm -f /usr/local/sbin/understory-install
    rm -rf "$PREFIX"
    if [ "$purge" = yes ]; then
        rm -rf "$CONFIG" "$STATE"
        if getent passwd "$USER_NAME" >/dev/null; then userdel "$USER_NAME"; fi
        if getent group "$USER_NAME" >/dev/null; then groupdel "$USER_NAME"; fi
        say "removed, with configuration, key and state"
    else
        say "removed; $CONFIG and $STATE are kept (--purge removes them)"
    fi
    ! has_systemd || systemctl daemon-reload
}

main() {
    action=install env_file='' key_file='' mission_file='' python=python3 force=no purge=no
    while [ $# -gt 0 ]; do
        case $1 in
        --env | --key | --replace-key | --mission | --python)
            [ $# -ge 2 ] || fail 2 "$1 needs a value"
            case $1 in
            --env) env_file=$2 ;;
            --key) key_file=$2 ;;
            --replace-key) key_file=$2 action=replace_key ;;
            --mission) mission_file=$2 ;;
            --python) python=$2 ;;
            esac
            shift
            ;;
        --rollback) action=rollback ;;
        --uninstall) action=uninstall ;;
        --purge) purge=yes ;;
        --force) force=yes ;;
        -h | --help)
            usage
            exit 0
            ;;
        *)
            usage >&2
            fail 2 "$1: no such option"
            ;;
        esac
        shift
    done
    [ "$(id -u)" = 0 ] || fail 3 "must be run as root (sudo)"
    umask 022
    "do_$action"
}

main "$@"
