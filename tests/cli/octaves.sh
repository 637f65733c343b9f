# Colours and normals of early prefixes: written, carried, filled, measured, and left out.
# memory: 256Mi
need=16
scene red.obj sphere n=40
{ echo "mtllib c.mtl"; awk '/^f/ { print (NR % 2 ? "usemtl red" : "usemtl green") } { print }' red.obj; } >c.obj
printf 'newmtl red\nKd 1 0 0\nnewmtl green\nKd 0 1 0\n' >c.mtl
pbs-gbuffer -q -r 200 c.obj -o c.cand
pbs-sample -q -n 3000 --measure c.tsv c.cand -o c.surf
pbs-sample -q -n 3000 --no-octaves --measure n.tsv c.cand -o n.surf
pbs-info c.surf | grep -c OCTV
pbs-info n.surf | grep -c OCTV
pbs-info --check c.surf n.surf
pbs-flatten c.surf -o c.pbs
pbs-flatten n.surf -o n.pbs
pbs-info --check c.pbs n.pbs
# What is left out is only what says so: the points are the same.
points() { pbs-info "$1" | awk '/ PNTS / { print $2, $5, $6, $7 }'; }
diff <(points c.pbs) <(points n.pbs) && echo "same points"
# Every second face is of another colour: the mean is far from each surfel's own.
cut -f 3 c.tsv | tr '\n' ' '; echo
column() { awk -F '\t' -v n="$2" -v l="$3" 'NR > 1 && $3 == l { print $n }' "$1"; }
for l in 64 256; do
    holds "$(column c.tsv 10 $l) > 80" "$l: own colours are wrong"
    holds "$(column c.tsv 11 $l) < $(column c.tsv 10 $l) / 5" "$l: averaged ones are not"
    holds "$(column n.tsv 11 $l) == $(column c.tsv 10 $l)" "$l: without octaves they are"
done
holds "$(column c.tsv 9 $need) >= 0 && $(column c.tsv 9 $need) < 0.2" "few holes"
# With a scene that has no colours.
pbs-gbuffer -q -r 100 red.obj | pbs-sample -q -n 400 -o g.surf
pbs-flatten g.surf c.surf -o gc.pbs
pbs-info gc.pbs | awk '/ OCTV / { print $2, $3, $4, $5, $6 }'
pbs-info --check gc.pbs
# The bytes depend on neither threads nor memory, as everywhere; a table needs a place.
status pbs-sample -q -n 100 --measure missing/x.tsv c.cand -o x.surf
ls
