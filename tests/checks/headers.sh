# Every header compiles alone, as C and, if it says so, as C++.
cd "$PBS_TOP" || exit 1
bad=0
for h in libcore/*/*.h formats/*/*.h cmd/*.h cmd/*/*.h cmd/*/*/*.h; do
    case "$h" in *_inner.h) continue ;; esac
    out=$(echo "#include \"$h\"" | ${CC:-cc} -std=c11 -D_GNU_SOURCE -Wall -Wextra -Werror -I. -fsyntax-only -xc - 2>&1) || { echo "$h:"; echo "$out" | head -5; bad=1; }
    grep -q '__cplusplus' "$h" || continue
    out=$(echo "#include \"$h\"" | ${CXX:-c++} -std=c++17 -Wall -Werror -I. -fsyntax-only -xc++ - 2>&1) || { echo "$h (C++):"; echo "$out" | head -5; bad=1; }
done
exit $bad
