#include "reader.h"

#include "clock.h"
#include "guardian.h"

#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

enum { READ_SIZE = 4096, AT = 8, ALL = 64 };

static const uint64_t FOR_EVER_US = UINT64_C(1) << 62;

/* Until the line is gone, or nobody listens any more. */
static void pass_on(int device, int pipe)
{
    uint8_t message[FRAME_HEAD + AT + READ_SIZE];
    struct pollfd line = {device, POLLIN, 0};
    for (;;) {
        ssize_t got = read(device, message + FRAME_HEAD + AT, READ_SIZE);
        if (got > 0) {
            size_t length = AT + (size_t)got;
            message[0] = (uint8_t)(length >> 8);
            message[1] = (uint8_t)length;
            put_u64(message + FRAME_HEAD, clock_us());
            if (!write_all(pipe, message, FRAME_HEAD + length, FOR_EVER_US))
                return;
        } else if (got == 0 || (errno != EAGAIN && errno != EINTR)) {
            return;
        } else {
            poll(&line, 1, -1);
        }
    }
}

bool reader_start(struct reader *reader, int device)
{
    int ends[2];
    pid_t parent = getpid();
    reader->in.fd = -1;
    reader->in.have = reader->in.used = 0;
    if (pipe(ends) != 0)
        return false;
    reader->pid = fork_named("starl_reader");
    if (reader->pid == 0) {
        close(ends[0]);
        signal(SIGINT, SIG_IGN);
        signal(SIGTERM, SIG_IGN);
        signal(SIGHUP, SIG_IGN);
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        for (int fd = 0; fd < ALL; fd++)
            if (fd != STDERR_FILENO && fd != device && fd != ends[1])
                close(fd);
        if (getppid() == parent)
            pass_on(device, ends[1]);
        _exit(0);
    }
    close(ends[1]);
    if (reader->pid < 0) {
        close(ends[0]);
        return false;
    }
    set_nonblocking(ends[0]);
    reader->in.fd = ends[0];
    return true;
}

void reader_end(struct reader *reader)
{
    if (reader->in.fd < 0)
        return;
    close(reader->in.fd);
    reader->in.fd = -1;
    kill(reader->pid, SIGKILL);
    while (waitpid(reader->pid, NULL, 0) < 0 && errno == EINTR)
        ;
}
