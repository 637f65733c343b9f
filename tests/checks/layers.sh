# cmd -> formats -> libcore, never back; foreign libraries only in formats/foreign; libcore never
# prints, exits or opens a path.
cd "$PBS_TOP" || exit 1
bad=0
say() { [ -z "$2" ] || { echo "$1:"; echo "$2"; bad=1; }; }
say "libcore includes from above" "$(grep -nE '#include "(formats|cmd|tests)/' libcore/*/*.[ch])"
say "formats includes from above" "$(grep -rnE '#include "(cmd|tests)/' formats)"
say "a foreign library outside formats/foreign" "$(grep -nE '#include <(OpenImageIO|openexr|OpenEXR|Imath|draco|tiny_gltf|nlohmann|CGAL)' libcore/*/*.[ch] $(find formats -name "*.[ch]" -not -path "formats/foreign/*") $(find cmd -name "*.[ch]"))"
say "C++ outside formats/foreign" "$(find cmd libcore formats tests -name '*.cpp' -o -name '*.hpp' | grep -vE '^(formats/foreign|tests/oracle|tests/peers)/')"
say "libcore prints, exits or opens" "$(nm -Au "$PBS_BUILD/libcore.a" | grep -wE 'printf|fprintf|vprintf|puts|putchar|fputs|fwrite|exit|abort|fopen|open|creat|getenv|perror|write|read')"
# The folders of a README's list are floors: each includes only from those above it in the list.
for top in libcore formats cmd/pbs-view; do
    above=$top/none
    for room in $(sed -n 's|^\([a-z]*\)/ .*|\1|p' $top/README); do
        above="$above|$top/$room"
        say "$top/$room includes from below it in $top/README" \
            "$(grep -HnE "#include \"$top/[a-z]+/" $(find $top/$room -name "*.[ch]*") | grep -vE "#include \"($above)/")"
    done
done
for d in cmd libcore formats tests tests/oracle tests/peers testdata man scripts cmd/pbs-view libcore/*/ formats/*/ cmd/pbs-view/*/; do
    d=${d%/}
    [ -e "$d/README" ] || { echo "$d has no README"; bad=1; continue; }
    for f in "$d"/*; do
        f=$(basename "$f")
        [ "$f" = README ] || grep -qwF -- "${f%.*}" "$d/README" || { echo "$d/README does not name $f"; bad=1; }
    done
done
exit $bad
