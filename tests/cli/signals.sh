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
kill $holder 2>/dev/null
rm pipe
ls
# Also while a pipe is full because nobody reads from it.
scene boxes.obj boxes n=2
mkfifo full
sleep 5 <full &
holder=$!
env --default-signal=INT pbs-gbuffer -q -r 512 boxes.obj >full 2>message.txt &
tool=$!
sleep 0.8
kill -INT $tool
wait $tool
echo "status $?"
cat message.txt
kill $holder 2>/dev/null
rm full
