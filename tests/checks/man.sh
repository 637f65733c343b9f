# Man pages are clean, and their options are the programs' options.
cd "$PBS_TOP" || exit 1
command -v mandoc >/dev/null || { echo "skip: mandoc is not installed"; exit 0; }
bad=0
for m in man/*.[157]; do
    out=$(mandoc -T lint -W warning "$m" 2>&1) || { echo "$out" | head; bad=1; }
done
for p in "$PBS_BUILD"/bin/pbs-*; do
    name=$(basename "$p")
    [ -e "man/$name.1" ] || { echo "man/$name.1 is missing"; bad=1; continue; }
    "$p" --help | grep -oE '^ +(-[a-z], )?--[a-z-]+' | sed -E 's/^ +//' | sort >"$TMPDIR/$name.help"
    sed -nE 's/^\.It Fl ([a-z]) ,? ?Fl -([a-z-]+).*/-\1, --\2/p; s/^\.It Fl -([a-z-]+).*/--\1/p' "man/$name.1" | sort >"$TMPDIR/$name.man"
    diff "$TMPDIR/$name.help" "$TMPDIR/$name.man" >"$TMPDIR/$name.diff" || { echo "$name: --help (<) and man page (>) differ:"; cat "$TMPDIR/$name.diff"; bad=1; }
done
# The keys of the window, each with what it does in one line.
"$PBS_BUILD/bin/pbs-view" --keys >"$TMPDIR/keys.help"
sed -n '/^\.Ss The window/,/^\.El/p' man/pbs-view.1 | awk '/^\.It /{ sub(/^\.It (Ic )?/, ""); gsub(/ , /, ", "); gsub(/\\&/, ""); name = $0; getline; print name "\t" $0 }' >"$TMPDIR/keys.man"
diff "$TMPDIR/keys.help" "$TMPDIR/keys.man" || { echo "the keys of the window: --keys (<) and pbs-view.1 (>) differ"; bad=1; }
exit $bad
