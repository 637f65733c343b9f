# Measured series: columns, rows, counts that are the same each time; paths, eyes, zones, names.
# once: one thread draws; threads and memory of the other programs have cases of their own
need_gl
scene s.obj boxes n=3 parts=1
pbs-gbuffer -q -n 10k s.obj | pbs-sample -q | pbs-flatten -q -o s.pbs
view() { pbs-view -q --width 160 --height 120 "$@"; }
cat >path.txt <<'END'
# around the corner, nearer, and a rest there
0    12 9 20   2 2 2
0.5, 20,9,12,  2,2,2,  0,1,0,  30

1 9 4 6  2 2 2  50   # close
2 9 4 6  2 2 2  50
END

echo "the table"
view --bench a.tsv --path path.txt --frames 5 --truth s.obj s.pbs
head -1 a.tsv
awk -F'\t' 'NR == 1 { n = NF } NF != n { bad = 1 } /^[0-9]/ { rows++ } /^#/ { printf "%s ", $1 } END { print rows " rows, " n " columns" (bad ? ", RAGGED" : "") }' a.tsv
cut -f1,2 a.tsv | sed -n 2,6p
# Times are not for the comparison of bytes.
untimed() { cut -f1,2,6- "$1"; }
view --bench b.tsv --path path.txt --frames 5 --truth s.obj s.pbs
cmp <(untimed a.tsv) <(untimed b.tsv) && echo "the same but for the times"
column() { awk -F'\t' -v name="$2" 'NR == 1 { for (i = 1; i <= NF; i++) if ($i == name) c = i; next } /^[0-9]/ { print $c }' "$1"; }
least() { column "$1" "$2" | sort -g | head -1; }
holds "$(least a.tsv draws) >= 1 && $(least a.tsv surfels) > 100 && $(least a.tsv nodes) >= 1" "something is drawn"
holds "$(least a.tsv gpu_ms) > 0 && $(least a.tsv cpu_ms) > 0 && $(least a.tsv wall_ms) > 0" "times are measured"
holds "$(least a.tsv ssim) > 0.5 && $(least a.tsv ssim) < 1" "pictures are like the geometry"
holds "$(column a.tsv ssim | sed -n 4p) == $(column a.tsv ssim | sed -n 5p)" "the last two are the same picture"
view -g --bench g.tsv --frames 2 --truth s.obj s.obj
column g.tsv ssim | sed 's/^/the truth against itself: /'
column g.tsv triangles | sed 's/^/triangles: /'
view --bench - --frames 2 s.pbs | untimed /dev/stdin | awk '/^[0-9]/' | cut -f1,2,9
printf '7 1 1 9 0 0 0\n7.1 1 1 8 0 0 0\n' >short.txt
view --path short.txt --bench c.tsv s.pbs && awk '/^[0-9]/' c.tsv | wc -l
rm ./?.tsv

echo "a picture of a time"
view --path path.txt --at 1.5 -s at.pam s.pbs
view --camera 9,4,6,2,2,2,50 -s there.pam s.pbs
cmp at.pam there.pam && echo "as the camera"

echo "two eyes"
view --camera 10,10,20,2,2,2 --stereo 10%,0 -s eyes.pam s.pbs
half() { # FILE FIRST-COLUMN: 80 columns of a picture of 160 x 120
    { printf 'P7\nWIDTH 80\nHEIGHT 120\nDEPTH 4\nMAXVAL 255\nTUPLTYPE RGB_ALPHA\nENDHDR\n'
      tail -c $((160 * 120 * 4)) "$1" | od -An -v -tx1 -w640 | awk -v c="$2" '{ s = ""; for (i = 1; i <= 320; i++) s = s $(i + 4 * c); print s }' | perl -ne 'chomp; print pack "H*", $_'; }
}
half eyes.pam 0 >left.pam
half eyes.pam 80 >right.pam
ssim() { pbs-compare --json "$1" "$2" | sed 's/.*"ssim": \([0-9.e-]*\).*/\1/'; }
holds "$(ssim left.pam right.pam) < 0.99" "the eyes see different pictures"
# The left eye alone: moved by half the distance along the camera's right.
awk 'BEGIN { bx = 8; by = 8; bz = 18; unit = sqrt(bx*bx + by*by + bz*bz); l = sqrt(bz*bz + bx*bx)
    s = unit * 0.05; x = bz / l * s; z = -bx / l * s
    printf "%.12f,10,%.12f,%.12f,2,%.12f\n", 10 - x, 20 - z, 2 - x, 2 - z
    printf "%.12f,10,%.12f,%.12f,2,%.12f\n", 10 + x, 20 + z, 2 + x, 2 + z }' >cameras
for eye in left right; do
    at=$(sed -n "$([ $eye = left ] && echo 1p || echo 2p)" cameras)
    pbs-view -q --width 80 --height 120 --camera "$at" -s single.pam s.pbs
    holds "$(ssim $eye.pam single.pam) > 0.98" "the $eye eye's part is the picture of a camera there"
done

# Both ways to draw that have targets of their own: each eye's part as without the other one.
for o in off on; do
    view --camera 10,10,20,2,2,2 --splat $o --stereo 10% -s eyes.pam s.pbs
    half eyes.pam 0 >left.pam
    half eyes.pam 80 >right.pam
    view --camera 10,10,20,2,2,2 --splat $o --stereo 10%,0 -s eyes.pam s.pbs
    half eyes.pam 0 >parallel.pam
    holds "$(ssim left.pam right.pam) > $(ssim parallel.pam right.pam)" "splats $o: the eyes meet at the target"
done

echo "zones"
for at in -2 2; do
    scene ball.obj sphere n=20 offset=$at
    pbs-gbuffer -q -n 3k ball.obj | pbs-sample -q -o ball$at.surf
done
pbs-flatten -q -o two.pbs ball-2.surf ball2.surf
two() { # NAME OPTION...
    local name=$1
    shift
    view --camera 0,0,20,0,0,0,40 --stats "$name.json" -s "$name.pam" "$@" two.pbs
    surfels=$(stat_of "$name.json" surfels)
}
two plain && all=$surfels
two same --zones 0:1 && cmp plain.pam same.pam && echo "a factor of 1 changes nothing"
two left --zones 5:1,20:4 --gaze 0.4,0.6 && left=$surfels
two outside --zones 5:1,20:4 --gaze 0,0.5 && outside=$surfels
holds "$left < 0.8 * $all && $outside < $left" "fewer surfels away from the gaze"
part() { # FILE LEFT: covered pixels whose column is in that half or not
    tail -c $((160 * 120 * 4)) "$1" | od -An -v -tu1 -w4 | awk -v l="$2" '{ if (((NR - 1) % 160 < 80) == l) print }' | cksum
}
[ "$(part left.pam 1)" = "$(part plain.pam 1)" ] && [ "$(part left.pam 0)" != "$(part plain.pam 0)" ] && echo "what one looks at is the same"
rm -f ./*.json

echo "names"
for at in 82,77 58,62 0,0 500,1; do view --pick $at s.pbs; view -g --pick $at s.obj; done
view --overlay -s over.pam s.pbs && view -s plain.pam s.pbs && cmp -s over.pam plain.pam || echo "an overlay is seen"

echo "bad input"
printf '0 1 2 3 4 5 6\n1 2 3\n\n2 1 2 3 1 2 3\nx\n' >bad.txt
status view --path bad.txt -s x.pam s.pbs
: >empty.txt
status view --path empty.txt -s x.pam s.pbs
status view --path absent.txt -s x.pam s.pbs
status view --bench absent/x.tsv s.pbs
status view --bench x.tsv --truth absent.obj s.pbs
status view --truth s.obj -s x.pam s.pbs
status view --window -s x.pam s.pbs
status view --bench x.tsv -s x.pam s.pbs
for z in "" 5 5:0 9:1,5:2; do status view --zones "$z" -s x.pam s.pbs; done
for g in 2,0 1 0,nan; do status view --gaze "$g" -s x.pam s.pbs; done
for d in 0 -1 1x 5%% inf 5%, 5%,-1 5%,1,1; do status view --stereo "$d" -s x.pam s.pbs; done
status view --pick 5 s.pbs
status view --frame-time 0 s.pbs
ls x.* 2>/dev/null
