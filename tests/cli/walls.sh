# Thin walls: with normals in the distance the surfels of one side do not stand for the other.
# memory: 512Mi
scene sheets.obj sheets
pbs-gbuffer -q -r 300 sheets.obj -o s.cand
for w in 0 1; do pbs-sample -q -n 10k -w $w --no-octaves --measure $w.tsv s.cand -o $w.surf; done
holes() { awk -F '\t' -v l="$2" 'NR > 1 && $3 == l { print $9 }' "$1.tsv"; }
for l in 1024 4096 10000; do
    holds "$(holes 0 $l) > 0.02 && $(holes 0 $l) > 5 * $(holes 1 $l)" "$l surfels: few wrong sides"
done
