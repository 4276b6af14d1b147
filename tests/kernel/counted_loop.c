/* A program of known length: two instructions a round, a million rounds for each argument.
 *
 * Owns: what the counter of instructions is checked by. 64-bit ARM only.
 */
int main(int argc, char **argv)
{
    long rounds = 1000000L * argc;

    (void)argv;
    __asm__ volatile("1: subs %0, %0, #1\n\tb.ne 1b" : "+r"(rounds) : : "cc");
    return 0;
}
