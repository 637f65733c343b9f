# An installed tree works from where it was put: programs, modules, man pages.
cd "$PBS_TOP" || exit 1
to=$(mktemp -d "$TMPDIR/install.XXXXXX")
config=$(basename "$PBS_BUILD")
make -s config="$config" install DESTDIR="$to" PREFIX=/opt/pbs >/dev/null || exit 1
unset PBS_MODULES
export PATH="$to/opt/pbs/bin:/usr/bin:/bin"
[ "$(command -v pbs-info)" = "$to/opt/pbs/bin/pbs-info" ] || exit 1
[ -e "$to/opt/pbs/share/man/man1/pbs-sample.1" ] && [ -e "$to/opt/pbs/share/man/man5/pbs-container.5" ] || { echo "no man pages"; exit 1; }
cd "$to" || exit 1
if [ -e "$to/opt/pbs/lib/pbs/gltf.so" ]; then pbs-gbuffer -q --ignore-missing -r 32 "$PBS_TOP/testdata/quads.gltf" -o a.cand; else "$PBS_TOP/scripts/mkscene" boxes n=1 | pbs-gbuffer -r 32 -o a.cand; fi || exit 1
pbs-sample -n 50 a.cand | pbs-flatten | pbs-info --check
