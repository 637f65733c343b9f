# Outputs: whole or not there; an old file stays until the new one is whole.
scene boxes.obj boxes n=2
echo old >keep.scene
status pbs-import gone.obj -o keep.scene
cat keep.scene
status pbs-import boxes.obj -o keep.scene
pbs-info --check keep.scene
status pbs-import boxes.obj -o no/such/folder/x.scene
mkdir folder
status pbs-import boxes.obj -o folder
status pbs-import boxes.obj >/dev/full
status pbs-info keep.scene >/dev/full
status pbs-import boxes.obj -o /dev/full
(status pbs-import boxes.obj 2>closed.txt; cat closed.txt) 2>&1 >/dev/null | head -c 0
pbs-gbuffer -r 256 boxes.obj 2>pipe.txt | head -c 100 >/dev/null
cat pipe.txt
ls -A
# A link stays a link, a private file stays private, and a name may be as long as names get.
echo old >private
chmod 600 private
ln -s private link
status pbs-import boxes.obj -o link
readlink link
stat -c %a private
pbs-import boxes.obj -o /dev/stdout >redirected
cmp private redirected && [ -L /dev/stdout ] && echo same
long=$(printf 'a%.0s' $(seq 250))
status pbs-import boxes.obj -o "$long"
rm "$long"
ls -A
