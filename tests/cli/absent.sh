# What a scene does not have costs nothing: no channel, no chunk, no module; the statistics say so.
scene plain.obj sphere n=16
awk '$1 == "v" { print $0, 0.5, 0.25, 1; next } { print }' plain.obj >coloured.obj
{ printf 'mtllib lamp.mtl\nusemtl lamp\n' && cat plain.obj; } >lamp.obj
awk 'BEGIN { print "mtllib picture.mtl\nusemtl picture" } $1 == "v" { print; print "vt", $2, $3; next }
     $1 == "f" { for (i = 2; i <= 5; i++) $i = $i "/" $i } { print }' plain.obj >picture.obj
printf 'newmtl lamp\nPm 0.5\nKe 1 1 0\n' >lamp.mtl
printf 'newmtl picture\nmap_Kd p.ppm\n' >picture.mtl
printf 'P6 1 1 255\nabc' >p.ppm
export PBS_MODULES=/nonexistent
for f in plain coloured lamp picture; do
    pbs-import -q $f.obj -o $f.scene
    pbs-gbuffer -q -r 32 $f.scene -o $f.cand --stats cand.json
    pbs-sample -q -n 200 $f.cand -o $f.surf --stats surf.json
    pbs-flatten -q $f.surf -o $f.pbs --stats pbs.json
    echo "== $f: $(pbs-info $f.scene | awk '$2 ~ /TEXR|MATL/ { print $2 }' | xargs)"
    for s in cand surf pbs; do
        sed -n 's/^ "channels": "\(.*\)",*$/\1/p' $s.json | tr '\n' ' '
        echo "= $(stat_of $s.json record_bytes)"
    done
done
echo "== each channel is paid for by its bytes alone"
pbs-info plain.surf | awk '$2 == "PNTS" { print $5, $6 }'
pbs-info coloured.surf | awk '$2 == "PNTS" { print $5, $6 }'
