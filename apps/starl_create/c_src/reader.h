/* The reader: a process that waits for what the line sends, and passes it on through a pipe.
 *
 * The kernel hands received bytes over by a worker of ordinary priority, and whoever polls or reads a
 * line waits until that has run. On a busy computer these are tens of milliseconds, by which a drive
 * script must not be late. */
#ifndef STARL_READER_H
#define STARL_READER_H

#include "frame.h"

#include <sys/types.h>

struct reader {
    struct frames_in in; /* messages: at:64, bytes; in.fd is -1 without a reader */
    pid_t pid;
};

bool reader_start(struct reader *reader, int device);
void reader_end(struct reader *reader);

#endif
