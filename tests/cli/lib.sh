# lib.sh: what every command-line case has at hand.

# Runs a command and prints its exit status, wherever its output goes.
exec 3>&1
status() {
    "$@"
    echo "status $?" >&3
}
# The same through sed, for numbers that are not the point: masked 's/1/N/' COMMAND...
masked() {
    local what=$1
    shift
    {
        "$@" 2>&1
        echo "status $?"
    } | sed "$what"
}
# A generated scene: scene NAME KIND [VAR=VALUE...]
scene() {
    local to=$1
    shift
    "$PBS_TOP/scripts/mkscene" "$@" >"$to"
}
# One number of a --stats file.
stat_of() { sed -n "s/.*\"$2\": \([-0-9.e+null]*\).*/\1/p" "$1"; }
# Says so if an arithmetic condition (awk) holds: holds "0.99 > 0.9" what is meant
holds() { awk "BEGIN { exit !($1) }" && echo "$2: yes" || echo "$2: NO ($1)"; }
# Copy of a file with one bit flipped: flip FILE BYTE
flip() {
    local b
    b=$(od -An -tu1 -j "$2" -N1 "$1" | tr -d ' ')
    # shellcheck disable=SC2059
    printf "$(printf '\\%03o' $((b ^ 1)))" | dd of="$1" bs=1 seek="$2" conv=notrunc 2>/dev/null
}
# Goes on only where OpenGL 4.5 is to be had; any other failure of the player is one of the case's.
need_gl() {
    local text
    text=$(pbs-view --width 16 --height 16 --shot gl.ppm "$PBS_TOP/testdata/v1/archive.pbs" 2>&1)
    case "$text" in *libEGL* | *"OpenGL: no device"*) echo "skip: no OpenGL here"; exit 0 ;; esac
    rm -f gl.ppm
}
models=/usr/share/assimp/models
need_models() { [ -d $models ] || { echo "skip: the Debian package assimp-testmodels is not installed"; exit 0; }; }
