/* Time: CLOCK_MONOTONIC in microseconds. */
#ifndef STARL_CLOCK_H
#define STARL_CLOCK_H

#include <stdint.h>

#define NEVER UINT64_MAX

uint64_t clock_us(void);
void clock_sleep_us(uint64_t us);

/* The earlier of two moments. */
static inline uint64_t earlier(uint64_t a, uint64_t b) { return a < b ? a : b; }

#endif
