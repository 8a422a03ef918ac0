/* Makes one kind of system call fail, or the clock jump, in the program that it is preloaded into
 * (LD_PRELOAD). tests/suite/hostile/faults.rs compiles it and says what by variables:
 *
 * HLOD_FAULT        read, write, sync, rename or clock
 * HLOD_FAULT_PATH   a part of the path of the files concerned
 * HLOD_FAULT_AT     the first call that fails, counted from 1
 * HLOD_FAULT_STAYS  1 where all later calls fail as well
 *
 * Renaming is refused by the kernel, for all files: Rust libraries ask it without the C library. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

static const char *fault = "", *path = "";
static long fails_at = 1;
static int stays;
static atomic_long calls, readings;

static int refuse_renaming(void)
{
#define REFUSED(number) BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, number, 0, 1), \
                        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | EIO)
    struct sock_filter filter[] = {
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, nr)),
#ifdef SYS_rename
        REFUSED(SYS_rename),
        REFUSED(SYS_link),
#endif
#ifdef SYS_renameat
        REFUSED(SYS_renameat),
#endif
        REFUSED(SYS_renameat2),
        REFUSED(SYS_linkat),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
    };
    struct sock_fprog program = { sizeof filter / sizeof *filter, filter };
    return prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) || prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program);
}

__attribute__((constructor)) static void begin(void)
{
    const char *text;
    if ((text = getenv("HLOD_FAULT"))) fault = text;
    if ((text = getenv("HLOD_FAULT_PATH"))) path = text;
    if ((text = getenv("HLOD_FAULT_AT"))) fails_at = atol(text);
    if ((text = getenv("HLOD_FAULT_STAYS"))) stays = atoi(text);
    if (!strcmp(fault, "rename") && refuse_renaming()) {
        fputs("this system has no filter of system calls\n", stderr);
        _exit(99);
    }
}

static int fails(const char *kind, int file)
{
    char link[64], name[4096];
    if (strcmp(fault, kind)) return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", file);
    ssize_t length = readlink(link, name, sizeof name - 1);
    if (length < 0) return 0;
    name[length] = 0;
    if (!strstr(name, path)) return 0;
    long call = ++calls;
    if (call < fails_at || (call > fails_at && !stays)) return 0;
    errno = EIO;
    return 1;
}

#define FAILING(kind, result, name, parameters, arguments)                \
    result name parameters                                                \
    {                                                                     \
        static result (*real) parameters;                                 \
        if (!real) real = (result (*) parameters) dlsym(RTLD_NEXT, #name); \
        return fails(kind, file) ? -1 : real arguments;                   \
    }

FAILING("read", ssize_t, read, (int file, void *to, size_t bytes), (file, to, bytes))
FAILING("read", ssize_t, pread64, (int file, void *to, size_t bytes, off64_t at), (file, to, bytes, at))
FAILING("read", ssize_t, readv, (int file, const struct iovec *to, int count), (file, to, count))
FAILING("write", ssize_t, write, (int file, const void *from, size_t bytes), (file, from, bytes))
FAILING("write", ssize_t, pwrite64, (int file, const void *from, size_t bytes, off64_t at), (file, from, bytes, at))
FAILING("write", ssize_t, writev, (int file, const struct iovec *from, int count), (file, from, count))
FAILING("sync", int, fsync, (int file), (file))
FAILING("sync", int, fdatasync, (int file), (file))

/* The time of day jumps by years in both directions, also to before 1970; what only counts on, as the
 * kernel promises, leaps ahead. */
int clock_gettime(clockid_t clock, struct timespec *now)
{
    int result = (int) syscall(SYS_clock_gettime, clock, now);
    if (strcmp(fault, "clock")) return result;
    long reading = ++readings;
    if (clock == CLOCK_REALTIME) now->tv_sec += (reading * 7919 % 101 - 70) * 40000000L;
    if (clock == CLOCK_MONOTONIC) now->tv_sec += 3600 * reading;
    return result;
}
