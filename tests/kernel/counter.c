/* Counts the instructions of a program that QEMU's user emulation runs: a plugin of the emulator.
 *
 * Owns: the count, written to the emulator's log when the program ends. Must not know: the program.
 * A program of one thread: several would count into one number at once.
 *
 * What is used of QEMU's plugin interface (version 1) is declared here, because no package has its
 * header. Code is translated block by block, and a block runs from its start to its end: only a
 * fault would leave it within.
 */
#include <inttypes.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#define SEEN_BY_QEMU __attribute__((visibility("default")))

typedef uint64_t plugin_id;
struct qemu_plugin_tb;
typedef void (*translated_cb)(plugin_id, struct qemu_plugin_tb *);
typedef void (*executed_cb)(unsigned int, void *);
typedef void (*ended_cb)(plugin_id, void *);

/* Of enum qemu_plugin_cb_flags: the callback looks at no register. */
enum { NO_REGISTERS = 0 };

void qemu_plugin_register_vcpu_tb_trans_cb(plugin_id, translated_cb);
void qemu_plugin_register_vcpu_tb_exec_cb(struct qemu_plugin_tb *, executed_cb, int, void *);
void qemu_plugin_register_atexit_cb(plugin_id, ended_cb, void *);
size_t qemu_plugin_tb_n_insns(const struct qemu_plugin_tb *);
void qemu_plugin_outs(const char *);

SEEN_BY_QEMU int qemu_plugin_version = 1;

static uint64_t counted;

static void executed(unsigned int cpu, void *instructions)
{
    (void)cpu;
    counted += (uintptr_t)instructions;
}

static void translated(plugin_id id, struct qemu_plugin_tb *block)
{
    uintptr_t instructions = qemu_plugin_tb_n_insns(block);

    (void)id;
    qemu_plugin_register_vcpu_tb_exec_cb(block, executed, NO_REGISTERS, (void *)instructions);
}

static void ended(plugin_id id, void *unused)
{
    char line[64];

    (void)id;
    (void)unused;
    snprintf(line, sizeof line, "instructions: %" PRIu64 "\n", counted);
    qemu_plugin_outs(line);
}

SEEN_BY_QEMU int qemu_plugin_install(plugin_id id, const void *about, int argc, char **argv)
{
    (void)about;
    (void)argc;
    (void)argv;
    qemu_plugin_register_vcpu_tb_trans_cb(id, translated);
    qemu_plugin_register_atexit_cb(id, ended, NULL);
    return 0;
}
