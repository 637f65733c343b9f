# Any of surfels, voxels, a point cloud and the scene itself become one archive; what a scene's
# meshes are put beside; equal parts once.
# memory: 40Mi
scene a.obj boxes n=2
pbs-import -q a.obj -o a.scene
pbs-gbuffer -q -r 100 a.scene | pbs-sample -q -n 400 -o a.surf
pbs-voxelize -q -r 300 a.scene | pbs-simplify -q -o a.vox
awk 'BEGIN { for (i = 0; i < 900; i++) print i % 30 / 10, int(i / 30) / 10, 9, i % 256, 0, 9 }' >c.xyz
tags() { # FILE: sorts of chunks in their order, how many, and of how many nodes
    pbs-info "$1" | awk '$2 ~ /^[A-Z]+$/ && $1 ~ /^[0-9]+$/ {
        if (!($2 in n)) order[++k] = $2
        if ($2 != last && $2 in n && !($2 == "PNTS" || $2 == "OCTV")) print "again: " $2
        if (!(($2, $3) in seen)) nodes[$2]++
        seen[$2, $3] = 1; n[$2]++; last = $2
    } END { for (i = 1; i <= k; i++) printf " %s %d/%d", order[i], n[order[i]], nodes[order[i]]; print "" }'
}
pack() { # NAME FILE...
    local name=$1
    shift
    echo "--- $*"
    pbs-flatten --stats $name.json -o $name.pbs "$@"
    pbs-info --check $name.pbs
    tags $name.pbs
    for s in scenes_matched triangles triangles_homeless; do
        [ -z "$(stat_of $name.json $s)" ] || printf ' %s %s' $s "$(stat_of $name.json $s)"
    done
    echo
}
pack s a.scene
pbs-info s.pbs | sed -n 1,3p
pack ps a.surf a.scene
pack vs a.vox a.scene
pack pv a.surf a.vox
pack pc a.surf c.xyz
pack vc a.vox c.xyz
pack sc a.scene c.xyz
pack pvs a.surf a.vox a.scene
pack all a.surf a.vox a.obj c.xyz
pbs-info --tree all.pbs | sed 's/  *$//'
echo "--- the scene is imported on the way, and comes from a pipe"
pbs-flatten -q a.surf a.vox a.scene c.xyz -o other.pbs
cmp <(tail -c +1025 all.pbs) <(tail -c +1025 other.pbs) && echo same
pbs-import -q - <a.obj | pbs-flatten -q a.surf - a.vox | pbs-info --check
pbs-flatten -q a.surf a.vox - <a.scene | pbs-info --check
echo "--- equal parts"
pack same a.surf a.surf a.vox a.vox
echo "--- a scene that is another one"
scene b.obj boxes n=3
pack other a.surf b.obj
pbs-info --tree other.pbs | sed 's/  *$//'
pack outside a.vox b.obj
echo "--- what is refused"
printf 'v 0 0 0\nv 1 0 0\nv 0 1 0\n' >none.obj
status pbs-flatten a.surf none.obj -o no.pbs
head -c 1500 a.scene >cut.scene
masked 's/byte [0-9]*/byte N/' pbs-flatten a.surf cut.scene -o no.pbs
status pbs-flatten a.scene pvs.pbs -o no.pbs
status pbs-flatten a.surf - -o no.pbs <a.obj
pbs-gbuffer -q -r 8 a.scene -o a.cand
status pbs-flatten a.cand a.scene -o no.pbs
masked 's/is too small.*/is too small/; s/: .*: -m/: -m/' pbs-flatten -m 12M a.vox a.scene -o no.pbs
test -e no.pbs || echo "no half archive"
cp ps.pbs bad.pbs
at=$(pbs-info bad.pbs | awk '$2 == "MESH" { print $1; exit }')
flip bad.pbs $((at + 64 + 20))
masked 's/byte [0-9]*/byte N/' pbs-info --check bad.pbs
rm -f ./*.json
