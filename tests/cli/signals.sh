# SIGINT and SIGTERM: status 76, no output file, also while waiting for a pipe.
mkfifo pipe
sleep 5 >pipe &
holder=$!
for sig in INT TERM; do
    # A shell makes background jobs deaf to SIGINT; env undoes it.
    env --default-signal=INT pbs-sample -o x.surf <pipe 2>message.txt &
    tool=$!
    sleep 0.4
    kill -$sig $tool
    wait $tool
    echo "status $?"
    cat message.txt
done
kill $holder
rm pipe
ls
