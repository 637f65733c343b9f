# The whole path, by files and by pipes: the same bytes.
scene boxes.obj boxes n=3
pbs-import boxes.obj -o boxes.scene
pbs-gbuffer -r 128 boxes.scene -o boxes.cand
pbs-sample -n 2000 boxes.cand -o boxes.surf
pbs-flatten boxes.surf -o boxes.pbs
pbs-info --check boxes.scene boxes.cand boxes.surf boxes.pbs
pbs-import <boxes.obj >p.scene
pbs-gbuffer -r 128 <boxes.scene >p.cand
pbs-sample -n 2000 <boxes.cand >p.surf
pbs-flatten <boxes.surf >p.pbs
# The header tells the name of the input, and chunks move with it; what is in them is the same.
chunks() { pbs-info "$1" | sed -n 's/^ *[0-9]* *\([A-Z]\)/\1/p'; }
for k in cand surf pbs; do diff <(chunks boxes.$k) <(chunks p.$k) && echo "same chunks: $k"; done
pbs-import boxes.obj | pbs-gbuffer -r 128 | pbs-sample -n 2000 | pbs-flatten | pbs-info --check
cat boxes.pbs | pbs-info | sed 's/[0-9a-f]\{8\}$//'
pbs-info boxes.pbs | sed 's/[0-9a-f]\{8\}$//'
pbs-info --nodes boxes.pbs
pbs-info --json boxes.pbs | sed 's/"crc": [0-9]*/"crc": 0/'
