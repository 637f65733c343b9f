# What a glTF animation moves moves in the player: as if the file had been written in that pose.
# memory: 768Mi
[ -e "$PBS_MODULES/gltf.so" ] || { echo "skip: the module gltf is not built"; exit 0; }
need_gl
number() { pbs-compare --json "$1" "$2" | sed 's/.*"'"$3"'": \([0-9.e+-]*\).*/\1/'; }
view() { pbs-view -q --device sw --width 160 --height 120 --samples 1 --camera 5,4,6,0,0.5,0 "$@"; }
for t in 0 0.7 1.3; do
    "$PBS_BUILD/tests/mkmotion" m$t.glb $t
    pbs-import -q m$t.glb -o m$t.scene
    pbs-gbuffer -q -n 3k m$t.scene | pbs-sample -q -n 3k -o m$t.surf
    pbs-flatten -q m$t.surf -o m$t.pbs
    pbs-flatten -q m$t.surf m$t.scene -o near$t.pbs
done
pbs-info --check m0.scene m0.surf m0.pbs near0.pbs
pbs-info --tree m0.pbs
pbs-info m0.pbs | grep -c -e ANIM -e MOTN
# Surfels, splats, source geometry in an archive and as it is: rounding is all that is between them.
for t in 0.7 1.3; do
    for how in mT.pbs "--splat on mT.pbs" nearT.pbs "--geometry mT.scene"; do
        # shellcheck disable=SC2086
        view --time $t --shot moved.pam ${how/T/0}
        # shellcheck disable=SC2086
        view --shot baked.pam ${how/T/$t}
        holds "$(number moved.pam baked.pam ssim) > 0.9995" "${how/T/$t}"
    done
done
view --shot rest.pam m0.pbs
holds "$(number rest.pam moved.pam ssim) < 0.97" "it moved"
# One animation of the two; none; the last moment of one that goes round.
view --time 0.7 --animation 0 --shot work.pam m0.pbs
view --time 0.7 --animation drum --shot drum.pam m0.pbs
view --time 0.7 --animation none --shot none.pam m0.pbs
view --time 0.7 --shot all.pam m0.pbs
cmp none.pam rest.pam && echo "none rests"
for a in work drum; do
    holds "$(number $a.pam rest.pam ssim) < 0.995 && $(number $a.pam all.pam ssim) < 0.995" "only $a"
done
view --time 2.7 --animation work --shot round.pam m0.pbs
cmp round.pam work.pam && echo "it goes round"
status view --animation walk --shot x.pam m0.pbs
status view --animation 2 --shot x.pam m0.pbs
# The time of a path is that of the animations, at a speed; the truth moves, too.
printf '0 5 4 6 0 0.5 0\n1 5 4 6 0 0.5 0\n' >still.path
view --path still.path --at 0.35 --speed 2 --time 0 --shot twice.pam m0.pbs
cmp twice.pam all.pam && echo "twice as fast"
pbs-flatten -q m0.scene -o whole.pbs
view --path still.path --time 0 --bench b.tsv --frames 3 --truth m0.scene whole.pbs
holds "$(awk -F'\t' '/^#min/ { print $13 }' b.tsv) > 0.9995" "a series: like the truth"
pick() { view --pick 85,48 "$@" m0.pbs; }
pick
pick --time 0.7
# Equal motions are one, and so are two equal files; other animations of the same name play with it.
pbs-flatten -q m0.surf m0.surf -o twice.pbs
pbs-flatten -q m0.surf m0.7.surf -o both.pbs
pbs-info --check twice.pbs both.pbs
pbs-info twice.pbs | grep -c -e ANIM -e MOTN
pbs-info both.pbs | grep -c -e ANIM -e MOTN
# Threads change no byte; voxels are at rest, and say so.
pbs-gbuffer -q -j 1 -n 3k m0.scene | pbs-sample -q -j 1 -n 3k | pbs-flatten -q -j 1 -o one.pbs
pbs-gbuffer -q -j 3 -n 3k m0.scene | pbs-sample -q -j 3 -n 3k | pbs-flatten -q -j 3 -o three.pbs
cmp one.pbs three.pbs && echo "same bytes"
pbs-voxelize -r 64 m0.scene -o m.vox
pbs-simplify -q m.vox | pbs-flatten -q -o v.pbs
pbs-info v.pbs | grep -c -e ANIM -e MOTN
rm -f ./*.pam ./*.tsv
