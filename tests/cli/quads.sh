# A masked texture, a mirrored placing, a blended and glowing material: what arrives of them.
# memory: 256Mi
[ -e "$PBS_MODULES/gltf.so" ] && [ -e "$PBS_MODULES/image.so" ] || { echo "skip: the modules gltf and image are not built"; exit 0; }
need_gl
pbs-gbuffer -r 200 "$PBS_TOP/testdata/quads.gltf" -o q.cand --stats q.json
pbs-info q.cand | head -4
pbs-sample -n 20k q.cand | pbs-flatten -o q.pbs
pbs-view --width 320 --height 240 --shot q.pam q.pbs
pbs-view --width 320 --height 240 --shot truth.pam -g "$PBS_TOP/testdata/quads.gltf"
pbs-compare --json q.pam truth.pam | sed 's/.*"hole": \([0-9.e-]*\), "spill": \([0-9.e-]*\).*/\1 \2/' >both
holds "$(cut -d' ' -f1 both) < 0.001" "no holes"
holds "$(cut -d' ' -f2 both) < 0.1" "the transparent half is not there"
