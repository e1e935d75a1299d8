#include "note.h"

#include "clock.h"

#include <fcntl.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

/* What has not come after this time was lost. */
enum { KEPT = 256, LOST_US = 500000 };

struct note {
    uint64_t total; /* bytes written so far */
    uint64_t at_us;
};

struct notes {
    _Atomic uint64_t opened; /* when the writer has opened the line */
    _Atomic uint64_t count;
    struct note kept[KEPT];
};

static const char *number(const char *tty)
{
    return strncmp(tty, "/dev/pts/", 9) == 0 ? tty + 9 : NULL;
}

static bool path_of(const char *tty, char *path, size_t size)
{
    const char *digits = number(tty);
    return digits && snprintf(path, size, "/dev/shm/starl-pts-%s", digits) < (int)size;
}

static struct notes *map(int fd)
{
    void *at = mmap(NULL, sizeof(struct notes), PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    close(fd);
    return at == MAP_FAILED ? NULL : at;
}

struct notes *notes_open(int tty)
{
    char name[64], path[96];
    struct stat is;
    if (ttyname_r(tty, name, sizeof name) != 0 || !path_of(name, path, sizeof path))
        return NULL;
    int fd = open(path, O_RDWR | O_NOFOLLOW | O_CLOEXEC);
    if (fd < 0)
        return NULL;
    if (fstat(fd, &is) != 0 || is.st_uid != geteuid() || is.st_size != sizeof(struct notes)) {
        close(fd);
        return NULL;
    }
    struct notes *notes = map(fd);
    if (notes) {
        atomic_store(&notes->count, 0);
        atomic_store(&notes->opened, clock_us());
    }
    return notes;
}

void notes_close(struct notes *notes)
{
    if (notes)
        munmap(notes, sizeof *notes);
}

static uint64_t total(struct notes *notes, uint64_t count)
{
    return count == 0 ? 0 : notes->kept[(count - 1) % KEPT].total;
}

void notes_put(struct notes *notes, size_t length)
{
    if (!notes)
        return;
    uint64_t count = atomic_load(&notes->count);
    notes->kept[count % KEPT] = (struct note){total(notes, count) + length, clock_us()};
    atomic_store(&notes->count, count + 1);
}

void notes_less(struct notes *notes, size_t length)
{
    if (notes)
        notes->kept[(atomic_load(&notes->count) - 1) % KEPT].total -= length;
}

void notes_make(struct notes_reader *reader, const char *tty)
{
    *reader = (struct notes_reader){.notes = NULL};
    if (!path_of(tty, reader->path, sizeof reader->path))
        return;
    unlink(reader->path);
    int fd = open(reader->path, O_RDWR | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600);
    if (fd < 0)
        return;
    if (ftruncate(fd, sizeof(struct notes)) == 0)
        reader->notes = map(fd);
    else
        close(fd);
}

void notes_remove(struct notes_reader *reader)
{
    if (!reader->notes)
        return;
    notes_close(reader->notes);
    reader->notes = NULL;
    unlink(reader->path);
}

/* The first note about bytes that have not been read, and their number. */
static size_t unread(struct notes_reader *reader, uint64_t *at_us)
{
    struct notes *notes = reader->notes;
    if (!notes)
        return 0;
    uint64_t opened = atomic_load(&notes->opened), count = atomic_load(&notes->count);
    if (opened != reader->opened) {
        reader->opened = opened;
        reader->total = 0;
    }
    for (uint64_t i = count > KEPT ? count - KEPT : 0; i < count; i++) {
        struct note note = notes->kept[i % KEPT];
        if (note.total > reader->total) {
            *at_us = note.at_us;
            return (size_t)(note.total - reader->total);
        }
    }
    return 0;
}

size_t notes_take(struct notes_reader *reader, size_t length, uint64_t now_us, uint64_t *at_us)
{
    size_t noted = unread(reader, at_us);
    if (noted == 0)
        *at_us = now_us;
    size_t taken = noted > 0 && noted < length ? noted : length;
    reader->total += taken;
    return taken;
}

uint64_t notes_upto(struct notes_reader *reader, uint64_t now_us)
{
    uint64_t at_us;
    while (unread(reader, &at_us) > 0) {
        if (now_us < at_us + LOST_US)
            return earlier(at_us, now_us);
        reader->total = total(reader->notes, atomic_load(&reader->notes->count));
    }
    uint64_t written = reader->notes ? total(reader->notes, atomic_load(&reader->notes->count)) : 0;
    /* somebody else has written as well */
    if (reader->total > written)
        reader->total = written;
    return now_us;
}
