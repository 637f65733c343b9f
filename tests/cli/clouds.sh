# Point clouds: every format to the same archive, exact; damaged and foreign files by their names.
points() { # N: x y z r g b, two decimals
    awk -v n="$1" 'BEGIN { for (i = 0; i < n; i++) { x = (i * 7919) % 9973; y = (i * 104729) % 9967
        printf "%.2f %.2f %.2f %d %d %d\n", x / 100 + 500000, y / 100, int(90 * sin(x / 900)) / 100, x % 256, y % 256, 77 } }'
}
points 3000 >a.xyz
{ echo 3000; awk '{ print $1, $2, $3, -5, $4, $5, $6 }' a.xyz; } >a.pts
{ echo x,y,z,r,g,b; tr ' ' , <a.xyz; } >a.csv
{
    printf 'ply\nformat ascii 1.0\nelement vertex 3000\n'
    printf 'property double %s\n' x y z
    printf 'property uchar %s\n' red green blue
    echo end_header
    cat a.xyz
} >a.ply
for f in xyz pts csv ply; do pbs-flatten a.$f --stats $f.json -o $f.pbs; done
pbs-info --check xyz.pbs
pbs-info --nodes xyz.pbs | cut -c1-42
for s in points points_left_out points_equal levels lattice record_bytes; do echo $s "$(stat_of xyz.json $s)"; done
same() { cmp <(tail -c +1025 xyz.pbs) <(tail -c +1025 "$1") && echo "$1: the same"; }
for f in pts csv ply; do same $f.pbs; done
cat a.xyz | pbs-flatten | cat >pipe.pbs
pbs-info --check pipe.pbs
awk 'NR <= 1000' a.xyz >one.xyz
awk 'NR > 1000' a.xyz >two.xyz
pbs-flatten one.xyz two.xyz | pbs-info --check

# not finite, equal
{ cat a.xyz; echo nan 0 0 1 2 3; echo 0 inf 0 1 2 3; cat one.xyz; } >odd.xyz
pbs-flatten odd.xyz --stats odd.json -o odd.pbs
echo "equal $(stat_of odd.json points_equal), left out $(stat_of odd.json points_left_out)"
pbs-info --check odd.pbs

# refused
head -c 300 a.ply >cut.ply
printf '5000\n1 2 3\n' >cut.pts
printf 'LASF' >cut.las
printf 'x' >a.laz
printf 'ASTM-E57' >a.e57
printf 'v 0 0 0\n' >a.obj
printf 'ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n' >mesh.ply
echo nan nan nan >none.xyz
echo 1 2 three >word.xyz
printf '1 2 3\n1 2 x\n' >line.xyz
for f in cut.ply cut.pts cut.las a.laz a.e57 a.obj mesh.ply none.xyz word.xyz line.xyz gone.las; do
    status pbs-flatten $f -o x.pbs
done
status pbs-flatten a.xyz xyz.pbs -o x.pbs
masked 's/: .*: -m/: -m/; s/at least .*/at least N/' pbs-flatten a.xyz -m 7Mi -o x.pbs
ls x.* 2>/dev/null
rm -f ./*.json
