#include "clock.h"

#include <time.h>

uint64_t clock_us(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * 1000000u + (uint64_t)now.tv_nsec / 1000u;
}

void clock_sleep_us(uint64_t us)
{
    struct timespec span = {(time_t)(us / 1000000u), (long)(us % 1000000u) * 1000};
    nanosleep(&span, NULL);
}
