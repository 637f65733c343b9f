# G-buffers as OpenEXR files: written, and read back as candidates.
# memory: 96Mi
[ -e "$PBS_MODULES/exr.so" ] || { echo "skip: the module exr is not built"; exit 0; }
scene boxes.obj boxes n=2
pbs-gbuffer -r 100 --exr buffers boxes.obj -o b.cand --stats b.json
ls buffers
pbs-sample -n 300 buffers/*.exr -o exr.surf --stats exr.json
pbs-sample -n 300 b.cand -o b.surf --stats sample.json
holds "$(stat_of exr.json candidates) == $(stat_of b.json candidates)" "as many candidates"
holds "$(stat_of exr.json covering_radius) < 1.1 * $(stat_of sample.json covering_radius)" "as good a covering"
pbs-flatten exr.surf | pbs-info --check
status pbs-sample gone.exr
echo no >bad.exr
status pbs-sample bad.exr
# Far from the origin: the files say where their positions belong.
scene far.obj sphere n=8 offset=1e7
pbs-gbuffer -q -r 50 --exr far far.obj -o far.cand
pbs-sample -n 100 far/*.exr | pbs-flatten -o far.pbs
pbs-info --nodes far.pbs | tail -1 | grep -c '\[9999999.*, 10000001'
