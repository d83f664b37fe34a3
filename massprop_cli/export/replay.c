/* Flies a test vector: vector.txt on standard input, on standard output what flight.h says after each cycle. `replay size`: RAM of the state.
 * The only file here that reads and writes, and the only one with a main; it is no part of what flies. */
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include "table.h"

static mp_flight flight;

/* A number's bits, as in expected.txt. */
static void put(mp_real value, int told) {
    double wide = (double)value;
    uint64_t bits;
    memcpy(&bits, &wide, sizeof bits);
    if (told) printf("%08lx%08lx ", (unsigned long)(bits >> 32), (unsigned long)(bits & 0xffffffffu));
    else printf("- ");
}

static void told(const mp_values *values) {
    int i;
    for (i = 0; i < 10; i++) put(values->value[i], values->told[i]);
    for (i = 0; i < 10; i++) put(values->sigma[i], values->told[i]);
    for (i = 0; i < 10; i++) printf(i < 9 ? "%d " : "%d\n", values->verdict[i]);
}

static int numbers(mp_real *to, int count) {
    int i;
    for (i = 0; i < count; i++) {
        double value;
        if (scanf("%la", &value) != 1) return 0;
        to[i] = (mp_real)value;
    }
    return 1;
}

static int cycle(mp_flown *flown) {
    mp_real flags[3];
    int fine = numbers(&flown->end_s, 1) && numbers(&flown->duration_s, 1) && numbers(flown->delta_theta, 3);
    fine = fine && numbers(flown->delta_v, 3) && numbers(flags, 3);
    fine = fine && numbers(flown->command, mp_commands_table.commands) && numbers(flown->speed, mp_vehicle_table[0].wheels);
    if (!fine) return 0;
    flown->deaf[0] = flags[0] > (mp_real)0;
    flown->deaf[1] = flags[1] > (mp_real)0;
    flown->unused = flags[2] > (mp_real)0;
    return 1;
}

static int sizes(void) {
    unsigned long whole = (unsigned long)sizeof flight, held = (unsigned long)sizeof flight.pass.held, ring = (unsigned long)sizeof flight.pass.ring;
    printf("sizeof(mp_flight) = %lu bytes: cycles held %lu, checkpoints %lu, all else %lu\n", whole, held, ring, whole - held - ring);
    return 0;
}

int main(int argc, char **argv) {
    int phase;
    long count, k;
    if (argc > 1) return strcmp(argv[1], "size") == 0 ? sizes() : 2;
    while (scanf("%d %ld", &phase, &count) == 2) {
        mp_values values;
        int made;
        if (phase < 0 || phase >= MP_PHASES) return 2;
        if (mp_flight_begin(&flight, &mp_commands_table, &mp_vehicle_table[phase], &mp_rule_table[phase]) != MP_OK) return 3;
        for (k = 0; k < count; k++) {
            mp_flown flown;
            if (!cycle(&flown)) return 2;
            if (mp_flight_step(&flight, &flown, &values, &made) != MP_OK) return 4;
            if (made) told(&values);
        }
        if (mp_flight_last(&flight, &values, &made) != MP_OK) return 4;
        if (made) told(&values);
    }
    return 0;
}
