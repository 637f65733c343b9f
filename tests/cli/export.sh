# PLY and GLB for others: what is written, read back by us and by Assimp, and what is refused.
# memory: 64Mi
awk 'BEGIN { for (i = 0; i < 20000; i++) { x = (i * 7919) % 9973; y = (i * 104729) % 9967
    printf "%.2f %.2f %.2f %d %d %d\n", x / 100 + 5000000, y / 100, int(90 * sin(x / 900)) / 100, x % 256, y % 256, 77 } }' >a.xyz
pbs-flatten -q a.xyz -o a.pbs
scene s.obj boxes n=2
pbs-gbuffer -q -r 64 s.obj | pbs-sample -q -n 500 -o s.surf
pbs-flatten -q s.surf -o s.pbs
"$PBS_BUILD/tests/mkvoxels" 512 nw >v.vox
pbs-flatten -q v.vox s.surf -o both.pbs
header() { tr -d '\r' <"$1" | sed '/^end_header/q' | grep -a . ; }
points() { grep -a -m 1 'element vertex' "$1"; }
echo "--- PLY"
pbs-export a.pbs -o a.ply
header a.ply
pbs-export -n 1000 --radius s.pbs -o s.ply
header s.ply
pbs-export -f ply -p 10 <s.surf >p.ply
points p.ply
pbs-export -s 1 --positions float a.pbs -o one.ply
header one.ply | grep -a ' x'
"$PBS_BUILD/tests/mkvoxels" 64 nwc >c.vox
pbs-export --faces c.vox -o v.ply
header v.ply
pbs-flatten -q c.vox s.surf -o mixed.pbs
pbs-export --faces mixed.pbs -o w.ply
cmp <(sed '1,/end_header/d' v.ply) <(sed '1,/end_header/d' w.ply) && echo "the same faces"
pbs-export both.pbs -l 1 -o b.ply
header b.ply | grep -a element
echo "--- what we read is what we wrote"
cut -d ' ' -f 1-3 a.xyz | pbs-flatten -q | pbs-export -f ply >plain.ply
pbs-flatten -q plain.ply | pbs-export -f ply >again.ply
for f in plain again; do
    sed '1,/end_header/d' $f.ply | od -An -v -w24 -tf8 | awk '{ printf "%.2f %.2f %.2f\n", $1, $2, $3 }' | sed 's/-0\.00/0.00/g' | sort >$f.txt
done
cut -d ' ' -f 1-3 a.xyz | sed 's/-0\.00/0.00/g' | sort | cmp - plain.txt && cmp plain.txt again.txt && echo "the same positions"
echo "--- GLB"
for f in a s mixed; do pbs-export -n 300 $f.pbs -o $f.glb; done
pbs-export --z-up -s 1 a.pbs -f glb | cat >up.glb
head -c 400 up.glb | tail -c +21 | grep -ao '"matrix":[^]]*]'
pbs-export --faces c.vox -o v.glb
for f in a s mixed up v; do echo $f "$(wc -c <$f.glb)"; done
echo "--- stats"
pbs-export -l 1 v.vox -v -o l.ply 2>&1 | grep voxels
pbs-export -v -n 300 s.pbs -o s.glb 2>&1 | grep -vE 'seconds|memory'
echo "--- colours of single faces"
printf 'newmtl r\nKd 1 0 0\nnewmtl g\nKd 0 0.5 0\n' >two.mtl
printf 'mtllib two.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 0.01\nv 1 0 0.01\nv 1 1 0.01\nv 0 1 0.01\nusemtl r\nf 1 4 3 2\nusemtl g\nf 5 6 7 8\n' >two.obj
for what in colour material; do
    pbs-voxelize -q -r 16 --orientation trust --per-face $what two.obj | pbs-flatten -q -o two.pbs
    pbs-export --faces two.pbs -o two-$what.ply
    # Four corners a face: place, normal, colour. What is under the plate is red, what is on it green.
    sed '1,/end_header/d' two-$what.ply | head -c $((28 * $(points two-$what.ply | cut -d ' ' -f 3))) |
        od -An -v -w28 -tf4 -tu1 | awk 'NR % 2 { z[int(NR / 2) % 4] = $3; next }
        NR % 8 == 0 && z[0] == z[1] && z[1] == z[2] { print (z[0] < 0.005) ? "under" : "on", $25, $26, $27 }' |
        sort | uniq -c
done
echo "--- refused"
status pbs-export a.pbs -o a.obj
status pbs-export a.pbs
status pbs-export -n 5 -s 1 a.pbs -o x.ply
status pbs-export -l 1 a.pbs -o x.ply
status pbs-export --faces a.pbs -o x.ply
status pbs-export -p 5 v.vox -o x.ply
status pbs-export --node 99 s.pbs -o x.ply
status pbs-export a.xyz -o x.ply
status pbs-export gone.pbs -o x.ply
status pbs-export -s -1 a.pbs -o x.ply
pbs-export -s 1e30 a.pbs -o none.glb
head -c 3000 a.pbs >cut.pbs
status pbs-export cut.pbs -o x.ply
cp s.pbs bad.pbs
flip bad.pbs $(($(pbs-info bad.pbs | awk '$2 == "PNTS" { print $1; exit }') + 200))
masked 's/byte [0-9]*/byte N/' pbs-export bad.pbs -o x.ply
ls x.* 2>/dev/null
rm -f ./*.json
