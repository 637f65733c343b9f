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
