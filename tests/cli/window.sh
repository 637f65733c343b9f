# The window, on a display that is only memory: keys, a name, flying, a series, the end.
# once: one thread draws; threads and memory of the other programs have cases of their own
need_gl
command -v Xvfb >/dev/null && command -v xdotool >/dev/null || { echo "skip: Xvfb or xdotool is not installed"; exit 0; }
screen=$(mktemp -d) || exit 1
cleanup() { kill "${server:-}" "${player:-}" 2>/dev/null; wait; rm -rf "$screen"; }
trap cleanup EXIT
Xvfb -displayfd 5 -screen 0 480x320x24 -fbdir "$screen" -nolisten tcp 5>"$screen/number" >/dev/null 2>&1 &
server=$!
# Waits until a command succeeds; half a minute, since the machine may be busy.
until_() {
    local i
    for i in $(seq 300); do "$@" >/dev/null 2>&1 && return 0; sleep 0.1; done
    echo "waited in vain for: $*"
    return 1
}
until_ test -s "$screen/number" || exit 0
DISPLAY=:$(cat "$screen/number")
export DISPLAY
unset PBS_MEMORY # GLX takes more than the case's little

# The screen as a picture: Xvfb keeps it in a file of the format of xwd.
grab() {
    perl -e 'binmode STDOUT; local $/; open my $f, "<:raw", $ARGV[0] or exit 1; my $x = <$f>;
        my @h = unpack "N25", $x; my ($w, $hh, $line, $at) = (@h[4, 5, 12], $h[0] + 12 * $h[19]);
        print "P6\n$w $hh\n255\n";
        for my $y (0 .. $hh - 1) { my $r = substr $x, $at + $y * $line, 4 * $w; $r =~ s/(.)(.)(.)./$3$2$1/gs; print $r }' \
        "$screen/Xvfb_screen0" >"$screen/$1.ppm"
}
differs() { grab "$2" && ! cmp -s "$screen/$1.ppm" "$screen/$2.ppm"; }
# Until the picture is another one than that of this name, and stays so.
settled() { grab a && sleep 0.4 && grab b && cmp -s "$screen/a.ppm" "$screen/b.ppm"; }
changed() { until_ differs "$1" "$2" && until_ settled && grab "$2"; }
title() { xdotool search --onlyvisible --name . getwindowname 2>/dev/null; }
titled() { title | grep -q "$1"; }

scene s.obj boxes n=2 parts=1
pbs-gbuffer -q -n 2k s.obj | pbs-sample -q | pbs-flatten -q -o s.pbs
printf '0 4 4 9  1.5 1.5 1.5\n0.3 9 4 4  1.5 1.5 1.5\n' >path.txt
grab empty
pbs-view --width 480 --height 320 --path path.txt s.pbs 2>player.err &
player=$!
changed empty first && until_ titled "surfels" && echo "a window with a picture"
pbs-view -q --width 480 --height 320 --path path.txt -s "$screen/shot.ppm" s.pbs
pbs-compare --json "$screen/first.ppm" "$screen/shot.ppm" | sed 's/.*"ssim": \([0-9.]*\).*/\1/' >"$screen/ssim"
holds "$(cat "$screen/ssim") > 0.98" "the same as without a display"

xdotool key h
changed first keys && echo "h: the keys are shown"
xdotool key h
until_ settled && grab back
cmp "$screen/first.ppm" "$screen/back.ppm" && echo "h: and gone"
xdotool mousemove 240 160 click 1
changed first named && until_ titled "s / box[0-9]" && echo "a click: a name"
xdotool key Right
changed named turned && echo "Right: it turns"
xdotool key 2
changed turned eyes && echo "2: two eyes"
xdotool key 2 f
xdotool keydown w
sleep 0.5
xdotool keyup w
xdotool key f
changed turned flown && echo "f, w: it flies"
xdotool key Home
changed flown home && xdotool key p && changed home played && echo "p: the path is played"
w=$(xdotool search --onlyvisible --name .)
xdotool windowsize "$w" 200 100
changed played small && xdotool windowsize "$w" 1 1 && sleep 0.3 && xdotool windowsize "$w" 300 200 &&
    changed small large && echo "a smaller window, one of a pixel, a larger one"
xdotool windowunmap "$w" windowmap "$w"
until_ titled "surfels" && echo "hidden and shown"
xdotool key q
wait $player
echo "q: status $?"
cat player.err

pbs-view -q --width 200 --height 150 --window --bench table.tsv --frames 3 s.pbs
echo "a series in a window: status $?, $(grep -c '^[0-9]' table.tsv) rows"
pbs-view -q --width 200 --height 150 s.pbs 2>player.err &
player=$!
until_ titled "surfels" && kill -TERM $player
wait $player
echo "a signal: status $?"
cat player.err
pbs-view -q --width 200 --height 150 --frame-time 5 --stereo 3% --zones 5:1,20:3 --gaze mouse s.pbs 2>player.err &
player=$!
until_ titled "surfels" && xdotool mousemove 10 10 mousemove 150 90 && sleep 0.5 && kill $server
wait $player
echo "the display goes away: status $?"
cat player.err
DISPLAY=:9999 pbs-view -q s.pbs 2>&1 | sed 's/: X11.*;/: WHY;/'
rm -f table.tsv player.err
