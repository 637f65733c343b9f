# Close-ups out of archives: triangles with their materials and textures, as the scene shows them;
# surfels and voxels give way to them without another colour.
# memory: 512Mi
need_gl
# picture NAME CELLS RED: a checkered texture.
picture() {
    LC_ALL=C awk -v n=64 -v cells="$2" -v red="$3" 'BEGIN {
        printf "P6\n%d %d\n255\n", n, n
        for (y = 0; y < n; y++) for (x = 0; x < n; x++)
            printf "%c%c%c", (int(x * cells / n) + int(y * cells / n)) % 2 ? 250 : red, 9 + 3 * x, 250 - 3 * y }' >"$1"
}
picture a.ppm 8 20
picture b.ppm 2 90
cp a.ppm same.ppm
picture unused.ppm 3 1
# ball X UPPER LOWER FIRST: a sphere of two materials; FIRST: vertices before it.
ball() {
    awk -v x0="$1" -v up="$2" -v down="$3" -v base="$4" 'BEGIN { n = 24; w = 2 * n + 1
        for (i = 0; i <= n; i++) for (j = 0; j < w; j++) {
            t = 3.14159265358979 * i / n; p = 3.14159265358979 * j / n
            x = sin(t) * cos(p); y = cos(t); z = sin(t) * sin(p)
            printf "v %.7f %.7f %.7f\nvt %.6f %.6f\nvn %.7f %.7f %.7f\n", x + x0, y, z, j / n * 2, i / n * 2, x, y, z }
        for (i = 0; i < n; i++) {
            print "usemtl " (i < n / 2 ? up : down)
            for (j = 0; j < 2 * n; j++) {
                a = base + i * w + j + 1; b = a + w
                printf "f %d/%d/%d %d/%d/%d %d/%d/%d %d/%d/%d\n", a, a, a, a + 1, a + 1, a + 1, b + 1, b + 1, b + 1, b, b, b } } }'
}
printf 'newmtl a\nmap_Kd a.ppm\nnewmtl plain\nKd 0.8 0.6 0.2\nnewmtl unused\nmap_Kd unused.ppm\nKd 1 0 0\n' >a.mtl
printf 'newmtl b\nmap_Kd b.ppm\nKd 0.5 1 1\nnewmtl same\nmap_Kd same.ppm\nNs 50\n' >b.mtl
{ echo mtllib a.mtl; ball 0 a plain 0; } >a.obj
{ echo mtllib b.mtl; ball 2.2 same b 0; } >b.obj
{ echo mtllib a.mtl b.mtl; ball 0 a plain 0; ball 2.2 same b 1225; } >ab.obj
view() { pbs-view -q --width 160 --height 128 "$@"; }
number() { pbs-compare --json "$1" "$2" | sed 's/.*"'"$3"'": \([0-9.e-]*\).*/\1/'; }
# mean FILE FILE: how far apart the mean colours of two PPM pictures are, of 255.
mean() {
    for f in "$@"; do od -An -v -tu1 -w3 -j 15 "$f"; done | awk '
        { n = NR > 160 * 128; for (k = 1; k <= 3; k++) sum[n, k] += $k }
        END { for (k = 1; k <= 3; k++) { d = (sum[0, k] - sum[1, k]) / NR * 2; if (d < 0) d = -d; if (d > most) most = d }
            print most }'
}
echo "--- in the place of surfels and of voxels"
pbs-gbuffer -q -n 16k a.obj | pbs-sample -q -n 16k -o a.surf
pbs-voxelize -q -r 256 a.obj -o a.vox
pbs-flatten -q -o surf.pbs a.surf
pbs-flatten -q -o vox.pbs a.vox
pbs-flatten -q -o surf-near.pbs a.surf a.obj
pbs-flatten -q -o vox-near.pbs a.vox a.obj
for s in surf,4.2 vox,1.7; do
    at=${s#*,},0.5,0.3,0,0,0,0,1,0,30 s=${s%,*}
    view --camera "$at" --shot truth.ppm -g a.obj
    view --camera "$at" --stats $s.json --shot $s.ppm $s.pbs
    view --camera "$at" --stats near.json --shot near.ppm $s-near.pbs
    holds "$(stat_of near.json triangles) > 0 && $(stat_of $s.json triangles) == 0" "$s: triangles"
    holds "$(number near.ppm truth.ppm ssim) > 0.9999" "$s: as in the scene"
    holds "$(mean $s.ppm near.ppm) < 1.5" "$s: the colours stay"
    holds "$(number $s.ppm near.ppm ssim) > 0.8" "$s: the picture stays"
done
echo "--- two scenes: materials and textures get other numbers, equal ones once, no unused ones"
pbs-flatten -q -o ab.pbs a.obj b.obj
pbs-info ab.pbs | awk '$2 == "TEXR"' | wc -l
at=1.1,1,6,1.1,0,0,0,1,0,35
view --camera $at --shot truth.ppm -g ab.obj
view --camera $at --shot ab.ppm ab.pbs
holds "$(number ab.ppm truth.ppm ssim) > 0.9999" "both as in their scenes"
echo "--- small limits"
view --camera $at --gpu-memory 1Mi --upload 8Ki --shot small.ppm ab.pbs
cmp small.ppm ab.ppm && echo "the same"
echo "--- a damaged texture is said once and shown white"
head -c 5000 a.ppm >cut.ppm
sed 's/a\.ppm/cut.ppm/' a.mtl >cut.mtl
sed 's/a\.mtl/cut.mtl/' a.obj >cut.obj
sed '/map_Kd/d' a.mtl >white.mtl
sed 's/a\.mtl/white.mtl/' a.obj >white.obj
pbs-flatten -q -o cut.pbs cut.obj
at=4.2,0.5,0.3,0,0,0,0,1,0,30
status pbs-view --width 160 --height 128 --camera $at --shot cut.ppm cut.pbs
view --camera $at --shot white.ppm -g white.obj
holds "$(number cut.ppm white.ppm ssim) > 0.9999" "white"
