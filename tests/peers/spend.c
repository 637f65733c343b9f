/* spend LIMIT TO COMMAND...: runs a command on one processor, so that whatever it would do on
 * several threads it does on one, and writes its CPU seconds (user and system) and its resident
 * bytes at most, with all processes below it, to the file TO. After LIMIT CPU seconds it is ended,
 * and the status is 75. */
#define _GNU_SOURCE
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

static void child(char **argv, rlim_t limit) {
    cpu_set_t all, one;
    CPU_ZERO(&one);
    if (!sched_getaffinity(0, sizeof all, &all)) {
        int last = 0;
        for (int i = 0; i < CPU_SETSIZE; i++)
            if (CPU_ISSET(i, &all)) last = i;
        CPU_SET(last, &one);
        sched_setaffinity(0, sizeof one, &one);
    }
    setrlimit(RLIMIT_CPU, &(struct rlimit){limit, limit});
    setenv("OMP_NUM_THREADS", "1", 1);
    execvp(argv[0], argv);
    perror(argv[0]);
    _exit(127);
}

int main(int argc, char **argv) {
    if (argc < 4) return 64;
    struct rusage u;
    int status;
    pid_t pid = fork();
    if (pid == 0) child(argv + 3, (rlim_t)atol(argv[1]));
    if (pid < 0 || wait4(pid, &status, 0, &u) != pid) return 70;
    if (WIFSIGNALED(status) && (WTERMSIG(status) == SIGXCPU || WTERMSIG(status) == SIGKILL))
        return 75;
    FILE *f = fopen(argv[2], "w");
    if (!f) return 74;
    fprintf(f, "%.6f %ld\n",
            (double)(u.ru_utime.tv_sec + u.ru_stime.tv_sec) +
                1e-6 * (double)(u.ru_utime.tv_usec + u.ru_stime.tv_usec),
            u.ru_maxrss * 1024);
    fclose(f);
    return WIFEXITED(status) ? WEXITSTATUS(status) : 70;
}
