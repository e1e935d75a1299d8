/* The speed of a line as a number. */
#ifndef STARL_SPEED_H
#define STARL_SPEED_H

#include <stdbool.h>

/* Any speed that the driver of the device takes, also one without a name in termios. */
bool speed_set(int fd, unsigned baud);
/* The speed that is set; 0: hung up, or not known. */
unsigned speed_get(int fd);

#endif
