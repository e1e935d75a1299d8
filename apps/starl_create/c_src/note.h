/* Notes of when bytes were written to a pty, for the emulator at its other end. A pty hands bytes over
 * when a worker of the kernel gets to it, on a busy computer tens of milliseconds later; a wire does
 * not wait for that. The helper makes the notes, a shared file; the port program writes them. A program
 * that writes none is believed to write when its bytes are read. */
#ifndef STARL_NOTE_H
#define STARL_NOTE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct notes;

/* The writer's end. */
struct notes *notes_open(int tty);
void notes_close(struct notes *notes);
/* So many bytes are about to be written; fewer were. */
void notes_put(struct notes *notes, size_t length);
void notes_less(struct notes *notes, size_t length);

/* The reader's end. */
struct notes_reader {
    struct notes *notes; /* NULL: none */
    uint64_t opened, total;
    char path[64];
};

void notes_make(struct notes_reader *reader, const char *tty);
void notes_remove(struct notes_reader *reader);
/* How many of the next bytes were written at once, and when. */
size_t notes_take(struct notes_reader *reader, size_t length, uint64_t now_us, uint64_t *at_us);
/* Until when all bytes that were written have been read. */
uint64_t notes_upto(struct notes_reader *reader, uint64_t now_us);

#endif
