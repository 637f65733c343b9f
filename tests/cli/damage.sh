# Damaged and foreign files: each its own message, status 65, no output.
scene boxes.obj boxes n=2
pbs-gbuffer -r 64 boxes.obj -o boxes.cand
pbs-sample -n 500 boxes.cand -o boxes.surf
pbs-flatten boxes.surf -o boxes.pbs
head -c 1000 boxes.cand >cut.cand
cp boxes.cand flip.cand; flip flip.cand 1000
cp boxes.cand head.cand; flip head.cand 80
cp boxes.cand newer.cand; printf '\377' | dd of=newer.cand bs=1 seek=12 conv=notrunc 2>/dev/null
cp boxes.cand feature.cand; printf '\1' | dd of=feature.cand bs=1 seek=16 conv=notrunc 2>/dev/null
tr -d '\r' <boxes.cand >text.cand
cp boxes.cand long.cand; echo >>long.cand
: >empty.cand
for f in cut flip head newer feature text long empty; do
    status pbs-sample $f.cand -o x.surf
    masked 's/byte [0-9]*/byte N/' pbs-sample -o x.surf <$f.cand
    status pbs-info --check $f.cand
done
status pbs-sample boxes.surf -o x.surf
status pbs-flatten boxes.cand -o x.pbs
status pbs-sample boxes.obj -o x.surf
status pbs-import boxes.pbs -o x.scene
status pbs-flatten boxes.surf gone.surf -o x.pbs
head -c 1500 boxes.pbs >cut.pbs
status pbs-view --shot x.ppm cut.pbs
status pbs-info cut.pbs
ls x.* 2>/dev/null
