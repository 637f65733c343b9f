# Assimp reads what pbs-export writes: as many points, where they are, of which kind.
command -v assimp >/dev/null || { echo "skip: the Debian package assimp-utils is not installed"; exit 0; }
awk 'BEGIN { for (i = 0; i < 4000; i++) printf "%d %d %d %d 0 255\n", 1e7 + (i * 7919) % 997, (i * 104729) % 991, i % 7, i % 256 }' >a.xyz
pbs-flatten -q a.xyz -o a.pbs
scene s.obj boxes n=2
pbs-gbuffer -q -r 64 s.obj | pbs-sample -q -n 500 -o s.surf
"$PBS_BUILD/tests/mkvoxels" 64 nwc >v.vox
seen() { # -r: Assimp thinks that meshes must have faces
    assimp info "$1" -r | grep -E '^(Vertices|Faces|Primitive|Minimum|Maximum point)' | sed 's/  */ /g'
}
for f in ply glb; do
    pbs-export -n 1000 a.pbs -o a.$f
    echo "a.$f: $(seen a.$f)"
    pbs-export s.surf -o s.$f
    echo "s.$f: $(seen s.$f)"
    pbs-export --faces v.vox -o v.$f
    echo "v.$f: $(seen v.$f)"
done
# and every number, in order
array() { sed -n '/"'"$2"'"/,/]/p' "$1" | tr -d ' \t,' | grep -E '^-?[0-9]'; }
floats() { sed '1,/end_header/d' "$1" | od -An -v -w"$2" -tf4; }
far() { # ours and theirs, a number a line: the largest difference
    paste -d ' ' ours theirs | awk 'NF != 2 { m = "lines" } NF == 2 { d = $1 - $2; if (d < 0) d = -d; if (d > m) m = d } END { print m + 0 }'
}
pbs-export s.surf -o b.glb
pbs-export s.surf --positions float -o b.ply
assimp export b.glb b.json -fassjson -r >/dev/null
array b.json transformation | awk 'NR % 4 == 0 && NR < 13' >moved
array b.json vertices | awk 'NR == FNR { t[NR % 3] = $1; next } { print $1 + t[FNR % 3] }' moved - >theirs
floats b.ply 24 | awk '{ print $1; print $2; print $3 }' >ours
holds "$(wc -l <ours) == 1500 && $(far) < 0.00002" "positions"
array b.json normals >theirs
floats b.ply 24 | awk '{ print $4; print $5; print $6 }' >ours
holds "$(wc -l <ours) == 1500 && $(far) < 0.00002" "normals"
pbs-export a.pbs -o c.glb
pbs-export a.pbs --positions float -o c.ply
assimp export c.glb c.json -fassjson -r >/dev/null
array c.json colors | awk '{ print 255 * ($1 <= 0.0031308 ? $1 * 12.92 : 1.055 * $1 ^ (1 / 2.4) - 0.055) }' >theirs
sed '1,/end_header/d' c.ply | od -An -v -w16 -tu1 | awk '{ for (k = 13; k < 17; k++) print $k }' >ours
holds "$(wc -l <ours) == 16000 && $(far) < 0.1" "colours"
rm -f ./*.json moved ours theirs
