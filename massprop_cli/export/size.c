/* RAM of the state. */
#include <stdio.h>

#include "flight.h"

int main(void) {
    printf("sizeof(mp_flight) = %lu bytes: cycles held %lu, checkpoints %lu, all else %lu\n", (unsigned long)sizeof(mp_flight),
           (unsigned long)(MP_HELD * sizeof(mp_cycle)), (unsigned long)(MP_CHECKPOINTS * sizeof(mp_run)),
           (unsigned long)(sizeof(mp_flight) - MP_HELD * sizeof(mp_cycle) - MP_CHECKPOINTS * sizeof(mp_run)));
    return 0;
}
