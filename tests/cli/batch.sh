# memory: 2Gi
# scripts/batch.mk: only what changed is built, failures are listed, kill -9 at any moment harms nothing.
mkdir -p tmp "in/sub dir" in/.hidden
scene in/a.obj boxes n=2
scene "in/sub dir/b 1.obj" sphere n=20
{ echo 'mtllib m #1.mtl'; cat in/a.obj; } >'in/c$x #1 50%'"'s.obj"
printf 'newmtl x\nKd 1 0 0\n' >'in/m #1.mtl'
cp in/a.obj in/.hidden/h.obj
export TMPDIR=$PWD/tmp
unset MAKEFLAGS MAKELEVEL
build() { # ARCHIVES [OPTION...]: lines in order, since two are built at a time
    make -s -j2 -f "$PBS_TOP/scripts/batch.mk" SCENES=in ARCHIVES="$1" PBSFLAGS='--count 500 -r 64' "${@:2}" 2>err | LC_ALL=C sort
    echo "status ${PIPESTATUS[0]}"
}
sums() { (cd "$1" && find . -name '*.pbs' -type f -print0 | sort -z | xargs -0r sha256sum); }
build 'out put'
echo again; build 'out put'
touch 'in/m #1.mtl'; build 'out put'
rm 'in/m #1.mtl'; build 'out put'
build 'out put' -k PBSFLAGS='--count 500 -r 64 --ignore-missing' | grep -c built
printf 'newmtl x\nKd 1 0 0\n' >'in/m #1.mtl'
echo junk >in/bad.obj
build keep -k
cat keep/bad.obj.log
rm in/bad.obj
rm -rf keep
# Killed, with all that it started, at moments spread over a build.
for wait in 0.05 0.15 0.25 0.35 0.45 0.6 0.8; do
    setsid make -s -j2 -f "$PBS_TOP/scripts/batch.mk" SCENES=in ARCHIVES=killed PBSFLAGS='--count 500 -r 64' >/dev/null 2>&1 &
    make=$!
    sleep $wait
    kill -KILL -- -$make
    wait $make
done 2>/dev/null
# What was killed between making a temporary file and taking its name away leaves the name.
find tmp -type f -delete
build killed >/dev/null
build whole >/dev/null
sums killed >one; sums whole >two
cmp one two && [ "$(wc -l <one)" = 3 ] && echo same
find killed -name '.*' | sort
find tmp -type f
rm -rf tmp err
find . -name .pbs -prune -exec rm -r {} +
rm -f one two
