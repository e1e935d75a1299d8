/* The pty helper: a line without a cable, for an emulator in Erlang. It adds no byte and takes none
 * away, as long as the other side reads.
 *
 *   in   W bytes   to the other side        out  n path       the name of the line
 *        P         pull the cable                d at:64 bytes
 *        R         put it back                   b baud:32    the other side's speed; 0: hung up
 *        T         tell the time                 t at:64      all bytes until then were told before
 *                                                a / h        the other side has opened / closed
 *                                                e word, 0, detail
 */
#include "port.h"

#include "clock.h"
#include "note.h"
#include "speed.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <unistd.h>

enum { READ_SIZE = 4096, LOOK_EACH_MS = 2 };

struct pty {
    struct frames_in in;
    struct frames_out out;
    int master; /* -1: the cable is pulled */
    unsigned baud;
    bool is_attached;
    struct notes_reader notes;
    const char *link; /* NULL: none */
    char name[64];    /* what it points at */
};

static const struct part none = {NULL, 0};

static struct part text(const char *chars) { return (struct part){chars, strlen(chars)}; }

static void fail(struct pty *pty, const char *word, const char *detail)
{
    frames_put(&pty->out, 'e', (struct part){word, strlen(word) + 1}, text(detail));
}

/* Raw from the start. Once it was open, a line that nobody has open says so (POLLHUP). */
static bool make_raw(const char *name)
{
    struct termios line;
    int slave = open(name, O_RDWR | O_NOCTTY);
    bool is_done = slave >= 0 && tcgetattr(slave, &line) == 0;
    if (is_done) {
        cfmakeraw(&line);
        is_done = tcsetattr(slave, TCSANOW, &line) == 0;
    }
    if (slave >= 0)
        close(slave);
    return is_done;
}

/* Only a link is replaced, never a file; and at once, so that there is always one name or none. */
static bool put_link(const char *link, const char *name)
{
    char new_link[PATH_LENGTH + 8], target[8];
    if (readlink(link, target, sizeof target) < 0 && errno != ENOENT) {
        errno = EEXIST;
        return false;
    }
    snprintf(new_link, sizeof new_link, "%s.%ld", link, (long)getpid() % 1000000);
    unlink(new_link);
    return symlink(name, new_link) == 0 && rename(new_link, link) == 0;
}

/* Another emulator may have been given the same link since. */
static void take_link(const struct pty *pty)
{
    char target[sizeof pty->name] = "";
    if (pty->link && readlink(pty->link, target, sizeof target - 1) > 0
        && strcmp(target, pty->name) == 0)
        unlink(pty->link);
}

static bool put_back(struct pty *pty)
{
    const char *name;
    if (pty->master >= 0)
        return true;
    pty->master = posix_openpt(O_RDWR | O_NOCTTY);
    if (pty->master < 0 || grantpt(pty->master) != 0 || unlockpt(pty->master) != 0
        || !(name = ptsname(pty->master)) || !make_raw(name)) {
        fail(pty, "io", strerror(errno));
        return false;
    }
    set_nonblocking(pty->master);
    if (pty->link && !put_link(pty->link, name)) {
        fail(pty, "link", strerror(errno));
        return false;
    }
    snprintf(pty->name, sizeof pty->name, "%s", name);
    pty->baud = 0;
    notes_make(&pty->notes, name);
    frames_put(&pty->out, 'n', text(name), none);
    return true;
}

static void pull(struct pty *pty)
{
    if (pty->master < 0)
        return;
    take_link(pty);
    close(pty->master);
    notes_remove(&pty->notes);
    pty->master = -1;
    pty->is_attached = false;
}

static void say_speed(struct pty *pty)
{
    uint8_t number[4];
    unsigned baud = speed_get(pty->master);
    if (baud == pty->baud)
        return;
    put_u32(number, baud);
    frames_put(&pty->out, 'b', (struct part){number, sizeof number}, none);
    pty->baud = baud;
}

static void set_attached(struct pty *pty, bool is_attached)
{
    if (is_attached != pty->is_attached)
        frames_put(&pty->out, is_attached ? 'a' : 'h', none, none);
    pty->is_attached = is_attached;
    if (is_attached)
        say_speed(pty);
}

/* What the other side has said, once. Whoever says something was there. */
static bool take(struct pty *pty)
{
    uint8_t bytes[READ_SIZE], at[8];
    uint64_t now = clock_us(), at_us;
    ssize_t got = read(pty->master, bytes, sizeof bytes);
    if (got <= 0)
        return false;
    set_attached(pty, true);
    for (size_t begin = 0, end = (size_t)got; begin < end;) {
        size_t length = notes_take(&pty->notes, end - begin, now, &at_us);
        put_u64(at, at_us);
        frames_put(&pty->out, 'd', (struct part){at, sizeof at}, (struct part){bytes + begin, length});
        begin += length;
    }
    return true;
}

/* Which speed the other side has set, and whether it is there at all. Its last words are read
 * after it has closed, also if it was there for a moment only. */
static void look(struct pty *pty)
{
    struct pollfd at = {pty->master, 0, 0};
    if (pty->master < 0)
        return;
    poll(&at, 1, 0);
    bool is_attached = !(at.revents & POLLHUP);
    if (!is_attached)
        while (take(pty))
            ;
    set_attached(pty, is_attached);
}

/* A line that nobody listens to, or too slowly, loses what is sent. */
static void write_line(struct pty *pty, const uint8_t *bytes, size_t length)
{
    look(pty);
    while (pty->is_attached && length > 0) {
        ssize_t sent = write(pty->master, bytes, length);
        if (sent <= 0)
            return;
        bytes += sent;
        length -= (size_t)sent;
    }
}

/* Bytes that come after this bear later times. */
static void say_time(struct pty *pty)
{
    uint8_t at[8];
    look(pty);
    while (pty->is_attached && take(pty))
        ;
    put_u64(at, notes_upto(&pty->notes, clock_us()));
    frames_put(&pty->out, 't', (struct part){at, sizeof at}, none);
}

static void message(struct pty *pty, const uint8_t *bytes, size_t length)
{
    char tag = length > 0 ? (char)bytes[0] : 0;
    if (tag == 'W')
        write_line(pty, bytes + 1, length - 1);
    else if (tag == 'P' && length == 1)
        pull(pty);
    else if (tag == 'R' && length == 1)
        put_back(pty);
    else if (tag == 'T' && length == 1)
        say_time(pty);
    else
        fail(pty, "bad_message", "of no known kind");
}

static bool erlang_ready(struct pty *pty, short events)
{
    const uint8_t *bytes;
    size_t length;
    if (events == 0)
        return true;
    if (!frames_read(&pty->in))
        return false;
    while ((bytes = frames_next(&pty->in, &length)))
        message(pty, bytes, length);
    return true;
}

int pty_run(const char *link)
{
    static struct pty pty = {.in.fd = STDIN_FILENO, .out.fd = STDOUT_FILENO, .master = -1};
    struct pollfd fds[3];
    bool is_open = true;
    signal(SIGPIPE, SIG_IGN);
    set_nonblocking(STDIN_FILENO);
    set_nonblocking(STDOUT_FILENO);
    pty.link = link;
    if (!put_back(&pty))
        return 1;
    while (is_open) {
        fds[0] = (struct pollfd){STDIN_FILENO, POLLIN, 0};
        fds[1] = (struct pollfd){STDOUT_FILENO, frames_waiting(&pty.out) ? POLLOUT : 0, 0};
        fds[2] = (struct pollfd){pty.is_attached ? pty.master : -1, POLLIN, 0};
        if (poll(fds, 3, pty.master >= 0 ? LOOK_EACH_MS : -1) < 0)
            continue;
        look(&pty);
        if (pty.is_attached && fds[2].revents & POLLIN)
            take(&pty);
        if (fds[1].revents & POLLOUT)
            frames_flush(&pty.out);
        is_open = erlang_ready(&pty, fds[0].revents) && !(fds[1].revents & POLLERR);
    }
    pull(&pty);
    return 0;
}
