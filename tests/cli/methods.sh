# Sampling methods: the exact one covers best; a seed changes the choice; the same seed does not.
scene sphere.obj sphere n=40
pbs-gbuffer -q -r 200 sphere.obj -o s.cand
for m in greedy paper random; do pbs-sample -n 1500 --method $m s.cand -o $m.surf --stats $m.json; done
g=$(stat_of greedy.json covering_radius) p=$(stat_of paper.json covering_radius) r=$(stat_of random.json covering_radius)
holds "$g < $p" "greedy covers better than the paper's heuristic"
holds "$p < $r" "the paper's heuristic covers better than chance"
holds "$(stat_of greedy.json min_spacing) >= $g" "greedy: no two surfels nearer than the covering radius"
pbs-sample -n 1500 --seed 7 s.cand -o seven.surf
pbs-sample -n 1500 --seed 7 s.cand | cmp - seven.surf && echo same
pbs-sample -n 5M s.cand -o all.surf --stats all.json
holds "$(stat_of all.json covering_radius) == 0" "all candidates: nothing is uncovered"
holds "$(stat_of all.json surfels) + $(stat_of all.json candidates_coincident) == $(stat_of all.json candidates)" "all candidates are accounted for"
