/* What must not depend on an interpreter's lock: ports that take time, a hog, a witness.
 *
 * Owns: as a library, calls that last as long as a port's system call and say when they began and
 * ended; as a program, `hog CORE` and `witness CORE PRIORITY OUT`. Must not know: chips, engines.
 *
 * The library's calls are made through ctypes, which releases the lock as a system call does.
 */
#define _GNU_SOURCE
#include <errno.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

static long now_ns(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000L + t.tv_nsec;
}

enum { STALLS = 100000 };
static const long STALL_NS = 100000;
/* From and to of each call that was longer than it was to be by STALL_NS. */
long stalls[STALLS][2];
long stalled;

/* Polled, as SPI messages and GPIO calls are; what interrupts it does not make it longer than that
 * lasts. Returns when it ended. */
long spend_busy(long duration_ns) {
    long begun = now_ns(), now = begun;
    while (now - begun < duration_ns) now = now_ns();
    if (now - begun - duration_ns > STALL_NS && stalled < STALLS) {
        stalls[stalled][0] = begun;
        stalls[stalled++][1] = now;
    }
    return now;
}

/* Waiting for an interrupt, as an I2C transaction does. */
void spend_asleep(long duration_ns) {
    struct timespec t = {duration_ns / 1000000000L, duration_ns % 1000000000L};
    while (nanosleep(&t, &t) && errno == EINTR) {}
}

static void bind_to(int core) {
    cpu_set_t cores;
    CPU_ZERO(&cores);
    CPU_SET(core, &cores);
    if (sched_setaffinity(0, sizeof cores, &cores)) { perror("sched_setaffinity"); exit(3); }
}

static volatile sig_atomic_t is_over;
static void end(int signal) { (void)signal; is_over = 1; }

/* What halts a message is a stall of more than 300 us; one of 400 us makes a look late by STALL_NS. More
 * often it would not look: a look in a thousand calls is a wait at p99.9 of its own making. */
static const long PERIOD_NS = 300000;

/* Above everything else on its core: who keeps it from waking is the host, or the kernel. Writes
 * from and to of each time that it woke late, and at last how often it was to wake. */
static int witness(int core, int priority, const char *out) {
    struct sched_param wanted = {.sched_priority = priority};
    bind_to(core);
    if (sched_setscheduler(0, SCHED_FIFO, &wanted)) { perror("sched_setscheduler"); return 3; }
    FILE *file = fopen(out, "w");
    if (!file) { perror(out); return 3; }
    long due = now_ns() + PERIOD_NS, looks = 0;
    while (!is_over) {
        struct timespec t = {due / 1000000000L, due % 1000000000L};
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL);
        long now = now_ns();
        looks++;
        if (now - due > STALL_NS) fprintf(file, "%ld %ld\n", due, now);
        due = now + PERIOD_NS;
    }
    fprintf(file, "%ld 0\n", looks);
    fclose(file);
    return 0;
}

int main(int count, char **words) {
    signal(SIGTERM, end);
    signal(SIGINT, SIG_IGN);
    if (count == 3 && !strcmp(words[1], "hog")) {
        bind_to(atoi(words[2]));
        while (!is_over) {}
        return 0;
    }
    if (count == 5 && !strcmp(words[1], "witness"))
        return witness(atoi(words[2]), atoi(words[3]), words[4]);
    fprintf(stderr, "hog CORE | witness CORE PRIORITY OUT\n");
    return 2;
}
