# memory: 512Mi
# pbs-sample --cache: of fifty parts of which one changed only that is sampled, and what holds it.
parts() { # CHANGED [FIRST=0]: sheets with bumps, each of its own shape
    awk -v changed="$1" -v first="${2:-0}" 'BEGIN { n = 24
        for (p = first; p < 50; p++) {
            print "o part" p
            a = p == changed ? 0.9 : 0.2 + p / 100
            for (y = 0; y <= n; y++) for (x = 0; x <= n; x++)
                printf "v %.6f %.6f %.6f 0.%d 0.5 0.5\n", p % 10 * 3 + x / n, int(p / 10) * 3 + y / n, a * sin(x * 0.3) * cos(y * 0.4), x % 10
            w = n + 1; b = (p - first) * w * w
            for (y = 0; y < n; y++) for (x = 0; x < n; x++) { i = b + y * w + x + 1
                print "f", i, i + 1, i + w + 1; print "f", i, i + w + 1, i + w }
        } }'
}
parts 99 >old.obj
parts 7 >new.obj
parts 99 1 >less.obj
for s in old new less; do pbs-gbuffer -q -n 2k $s.obj -o $s.cand; pbs-sample $s.cand -o $s.surf; done
sample() { pbs-sample "$1.cand" -o got.surf --stats got.json "${@:2}" && cmp got.surf "$1.surf" && echo "$1: same"; }
cached() { echo "$(stat_of got.json nodes_cached) of $(stat_of got.json nodes_sampled)"; }
sample old --cache kept
cached
sample old --cache kept
cached | awk '{ print $1 == $3 ? "all found" : "NOT all found: " $0 }'
sample new --cache kept
cached | awk '{ print ($1 >= $3 - 4 && $1 < $3) ? "nearly all found" : "NOT nearly all found: " $0 }'
sample less --cache kept # every node has another number now
cached | awk '{ print ($1 >= $3 - 4 && $1 < $3) ? "nearly all found" : "NOT nearly all found: " $0 }'
# Damage is not found, and mended.
for f in kept/*; do flip "$f" 150; done
sample old --cache kept
cached | awk '{ print $1 }'
sample old --cache kept
cached | awk '{ print $1 == $3 ? "all found" : "NOT all found: " $0 }'
# Other parameters are others.
pbs-sample -w 0.5 old.cand -o half.surf
pbs-sample -w 0.5 --cache kept old.cand -o got.surf --stats got.json && cmp got.surf half.surf && cached | awk '{ print $1 }'
# A limit, and a folder that takes nothing.
sample old --cache kept --cache-size 100k
holds "$(cat kept/* | wc -c) <= 100000" 'the cache is small'
sample old --cache kept --cache-size 100k
status pbs-sample old.cand --cache old.cand -o /dev/null
status pbs-sample old.cand --cache no/such/folder -o /dev/null
rm -rf kept
