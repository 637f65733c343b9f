# Far away, tiny, huge, needles: as the plain twin.
candidates() { pbs-gbuffer -q -r 100 "$1" -o "$1.cand" --stats "$1.g" && pbs-sample -q -n 500 "$1.cand" -o "$1.surf" --stats "$1.s"; }
points() { pbs-info "$1.cand" | sed -n 's/.* PNTS//p'; }
same() { [ -n "$(points "$1")" ] && cmp <(points "$1") <(points "$2") && echo "same points: $3"; }
near() { holds "($2) > (1 - $4) * ($3) && ($2) < (1 + $4) * ($3)" "$1"; }
# As the plain scene but for the unit of length: twin NAME UNIT TOLERANCE
twin() {
    local plain=${1%%.*}.obj
    near "$1: candidates" "$(stat_of "$1.g" candidates)" "$(stat_of "$plain.g" candidates)" "$3"
    near "$1: pixel" "$(stat_of "$1.g" pixel)" "$2 * $(stat_of "$plain.g" pixel)" 1e-6
    near "$1: covering radius" "$(stat_of "$1.s" covering_radius)" "$2 * $(stat_of "$plain.s" covering_radius)" 0.03
}
for kind in boxes needles; do
    scene $kind.obj $kind && candidates $kind.obj
    scene $kind.far $kind offset=1e7 && mv $kind.far $kind.far.obj && candidates $kind.far.obj
    twin $kind.far.obj 1 0.002
    for scale in 1e-9 1e9 1073741824; do
        scene $kind.$scale.obj $kind scale=$scale && candidates $kind.$scale.obj
        twin $kind.$scale.obj $scale 0.002
    done
done
same boxes.obj boxes.far.obj "10^7 away"
near "nothing is left of the needles but the box" "$(stat_of needles.obj.g candidates)" \
    "$(scene needles.none.obj needles n=100 aspect=1e30 && candidates needles.none.obj && stat_of needles.none.obj.g candidates)" 0.002
rm -f ./*.g ./*.s
