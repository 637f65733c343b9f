# memory: 2Gi
# pbs-build: the pipeline it prints is the one it runs, and the first error is the one that counts.
scene a.obj boxes n=2
cp a.obj ./-dash.obj
scene "it's b.obj" boxes n=3
export TMPDIR=$PWD/tmp
mkdir tmp
pbs-build -n -m 1Gi --count 500 "it's b.obj" -o a.pbs
pbs-build --dry-run -vqm1G -j2 -r 64 -w.5 --ignore-missing --top-down --keep-going --cache 'c d' -oout.pbs -- -dash.obj a.obj
# What is printed does the same.
status pbs-build -q --count 500 "it's b.obj" -o run.pbs
pbs-build -n -q --count 500 "it's b.obj" -o pasted.pbs >commands
sh commands
cmp run.pbs pasted.pbs && echo same
by_hand() { pbs-import "$1" | pbs-gbuffer -n 500 | pbs-sample -n 500 "${@:2}"; }
by_hand "it's b.obj" | pbs-flatten -o hand.pbs
cmp run.pbs hand.pbs && echo same
newline='new
line.obj'
cp a.obj "$newline"
pbs-build -q --count 500 "$newline" ./-dash.obj "it's b.obj" -o three.pbs --stats three.json --depend three.d
pbs-build -n -q --count 500 a.obj ./-dash.obj "it's b.obj" -o three.pbs --stats three.json --depend three.d | sed 's/-m [0-9]*Mi/-m N/g'
pbs-build -q --count 500 -o three.pbs --stats three.json --depend three.d -- a.obj -dash.obj "it's b.obj"
grep -c '"program"' three.json
cat three.d
pbs-info --nodes three.pbs | cut -c1-40
# A pbs file begins where it belongs.
pbs-import a.obj -o a.scene
pbs-gbuffer -n 500 a.obj -o a.cand
by_hand a.obj -o a.surf
for f in a.scene a.cand a.surf; do
    pbs-build -n -m 1Gi --count 500 $f -o from.pbs
    pbs-build -q --count 500 $f -o from.pbs && pbs-info --check from.pbs
done
cp a.surf ./-b.surf
pbs-build -q --depend none.d -o from.pbs -- -b.surf a.surf -b.surf && pbs-info --check from.pbs
[ -e none.d ] || echo "no rule"
pbs-build -q --count 500 - -o - <a.obj | pbs-info --check -
# Errors: one line, the first stage's status, no output.
echo junk >junk.obj
mkdir out
status pbs-build gone.obj -o out/x.pbs
status pbs-build junk.obj a.obj -o out/x.pbs
status pbs-build --count 12x a.obj -o out/x.pbs
status pbs-build -w 7 a.obj -o out/x.pbs
masked 's/-m [0-9]*Mi/-m N/g' pbs-build -m 70Mi -j 1 a.obj -o out/x.pbs
# The limit that is named is the one of the whole.
m=70 rounds=0
while ! pbs-build -q -j 1 -m ${m}Mi --count 1k a.obj -o out/x.pbs 2>why && [ $rounds -lt 4 ]; do
    m=$(sed -n 's/.*at least -m \([0-9]*\)Mi is needed/\1/p' why) rounds=$((rounds + 1))
done
pbs-info --check out/x.pbs
rm out/x.pbs why
status pbs-build a.obj -o no/x.pbs
status pbs-build --count 100 a.obj >/dev/full
status pbs-build -m 1x a.obj -o out/x.pbs
PBS_MEMORY=lots status pbs-build a.obj -o out/x.pbs
status pbs-build -x a.obj
status pbs-build --frobnicate a.obj
status pbs-build --quiet=yes a.obj
status pbs-build a.obj -o
status pbs-build
PATH=/usr/bin:/bin status sh "$(command -v pbs-build)" --version | sed 's/[0-9.]*$/N/'
# A stage that is killed from outside.
scene fine.obj sphere n=200
pbs-build -q --count 1M -r 2500 fine.obj -o out/x.pbs & 
build=$!
for _ in $(seq 100); do victim=$(ps -o pid=,comm= --ppid $build | sed -n 's/ pbs-gbuffer$//p'); [ -z "$victim" ] || break; sleep 0.05; done
kill -KILL $victim
wait $build
echo "status $?"
# Signals: everything stops, nothing stays.
for sig in INT TERM HUP; do
    env --default-signal pbs-build -q --count 1M -r 2500 fine.obj a.obj -o out/x.pbs &
    build=$!
    sleep 0.5
    kids=$(ps -o pid= --ppid $build)
    kill -$sig $build
    wait $build
    echo "status $?"
    for k in $kids; do kill -0 $k 2>/dev/null && echo "$k is still there"; done
done
ls -A out tmp
# One line on a terminal.
if command -v script >/dev/null; then
    script -qec "pbs-build --count 2k -r 1000 a.obj -o tty.pbs" /dev/null </dev/null | tr '\r' '\n' >tty
    grep -q 'pbs-build: a.obj: import' tty || { echo "no progress:"; cat tty; }
    grep -v 'pbs-build: a.obj: ' tty | tr -d '\033\n' | sed 's/\[K//g'
fi
PBS_PROGRESS=told pbs-sample a.cand -o told.surf && sed 's/^\(pbs-sample\) [0-9-]* [0-9-]* /\1 N N /' told | sort -u
rm -f tty told three.d.new commands *.json
