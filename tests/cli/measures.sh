# What --stats says against what others say: sizes of files, records in them, the shell's clock.
# memory: 128Mi
scene s.obj boxes n=3 parts=1
TIMEFORMAT='%R %U %S'
# measured NAME PROGRAM...: to the file NAME, with the figures in NAME.json and the shell's in NAME.time
measured() {
    local name=$1
    shift
    { time "$@" -q --stats "$name.json" -o "$name" 2>&4; } 4>&2 2>"$name.time"
    holds "$(stat_of "$name.json" bytes) == $(stat -c %s "$name")" "$name: bytes"
    # The clock of a busy machine is not exact.
    read -r real user sys <"$name.time"
    holds "$(stat_of "$name.json" seconds) <= $real + 0.01 && $(stat_of "$name.json" seconds) >= 0.5 * $real - 0.2" "$name: seconds"
    holds "$(stat_of "$name.json" cpu_seconds) <= $user + $sys + 0.02 && $(stat_of "$name.json" cpu_seconds) >= 0.8 * ($user + $sys) - 0.02" "$name: cpu_seconds"
    # More than is counted may be mapped or the C library's; a program counts 6 MiB that it may not need.
    holds "$(stat_of "$name.json" memory_counted) >= 6 * 1048576 && $(stat_of "$name.json" memory_resident) > 1048576" "$name: memory"
}
measured scene pbs-import s.obj
measured cand pbs-gbuffer -n 5k scene
measured surf pbs-sample -n 5k cand
measured vox pbs-voxelize -r 200 scene
measured lod pbs-simplify vox
measured pbs pbs-flatten surf lod
measured ply pbs-export -f ply pbs

echo "records"
records() { pbs-info "$1" | awk -v tag="$2" '$2 == tag { n += $5 } END { print n + 0 }'; }
holds "$(stat_of cand.json candidates) == $(records cand PNTS) && $(stat_of surf.json candidates) == $(records cand PNTS)" "candidates"
holds "$(stat_of surf.json surfels) == $(records surf PNTS) && $(stat_of pbs.json surfels) == $(records surf PNTS)" "surfels"
holds "$(stat_of vox.json voxels) == $(records vox VOXL) && $(stat_of lod.json voxels) == $(records vox VOXL)" "voxels"
holds "$(stat_of lod.json voxels) + $(stat_of lod.json voxels_coarser) == $(records lod VOXL) && $(stat_of pbs.json voxels) == $(records lod VOXL)" "their levels"
holds "$(stat_of scene.json triangles) == $(grep -c '^f' s.obj) * 2 && $(stat_of vox.json triangles) == $(stat_of scene.json triangles)" "triangles"

echo "memory"
# What the system says of a child, where there is a program that asks it.
if [ -x /usr/bin/time ]; then
    /usr/bin/time -f %M -o rss pbs-sample -q -n 5k cand -o surf --stats surf.json
    holds "$(stat_of surf.json memory_resident) <= 1024 * $(cat rss) && $(stat_of surf.json memory_resident) >= 900 * $(cat rss)" "memory_resident"
else
    echo "memory_resident: yes"
fi
# What is refused says what would do, and that does, without counting more.
needed=$(pbs-sample -q -j 1 -n 5k cand -o surf -m 8Mi 2>&1 | sed 's/.*at least -m \([0-9]*\)Mi is needed/\1/')
pbs-sample -q -j 1 -n 5k cand -o surf -m "${needed}Mi" --stats m.json
holds "$(stat_of m.json memory_counted) <= $needed * 1048576 && $(stat_of m.json memory_counted) > 8 * 1048576" "memory_counted is what -m limits"

echo "-v says the same"
pbs-sample -v -j 1 -n 5k cand -o surf --stats v.json 2>said
grep -cE '^pbs-sample: [a-z_0-9]+ ' said | grep -qx "$(grep -c '^ "' v.json)" && echo "as many lines"
sed -n 's/^ "\(.*\)": \(.*[^,}]\)[,}]*$/pbs-sample: \1 \2/p' v.json | diff - said && echo "the same lines"

echo "to standard error"
pbs-import -q --stats - s.obj -o scene 2>said
head -c 25 said
echo
{ pbs-gbuffer -q -n 500 --stats - s.obj | pbs-sample -q --stats - | pbs-flatten -q --stats - -o pbs; } 2>said
perl -MJSON::PP -e 'local $/; my $j = JSON::PP->new; $j->incr_parse(scalar <STDIN>); while (my $o = $j->incr_parse) { print "$o->{program}\n" }' <said | sort
pbs-build -q --count 500 --stats - s.obj -o pbs 2>said && perl -MJSON::PP -e 'local $/; print scalar @{ decode_json(<STDIN>)->{stages} }, " stages\n"' <said
ls ./-* 2>/dev/null
rm -f ./*.json ./*.time said rss scene cand surf vox lod pbs ply
