/* The port program: what it holds, and the messages from and to Erlang.
 *
 *   in   O baud:32 heartbeat-ms:32 path   open            out  o at:64 path          opened
 *        W bytes                          write                d at:64 bytes         data
 *        D mark:64 ... (script.h)         drive script         s mark:64 at:64       script: first bytes left
 *        Z bytes                          stop bytes           n mark:64 at:64       script: last bytes left
 *        H                                heartbeat            x at:64 word          it stopped the wheels
 *        L line:8 low-ms:16 times:8       pulse                c at:64 word          the device is gone
 *        B ms:16                          break                e word, 0, detail     a message failed
 *        S baud:32                        speed
 *        C                                close              p at:64 word          its priority, at first
 */
#ifndef STARL_PORT_H
#define STARL_PORT_H

#include "device.h"
#include "frame.h"
#include "guardian.h"
#include "reader.h"
#include "script.h"

struct port {
    struct frames_in in;
    struct frames_out out;
    struct device device;
    struct guardian guard;
    struct reader reader;
    struct script script;

    uint8_t stop[STOP_MAX];
    size_t stop_length;

    /* What the line has not taken yet; while there is any, no further message is read. */
    uint8_t pending[FRAME_MAX];
    size_t pending_at, pending_end;

    uint64_t heartbeat_us, heard_us; /* 0: no heartbeat is asked for */
    bool is_silent;                  /* the heartbeat was missed */
    bool is_stale;                   /* what is read was sent while this program was halted */

    bool may_move; /* something was written after the wheels were stopped last */
    bool is_lost;  /* the device went away; it is looked for */
    uint64_t look_us;

    enum control_line line; /* of the pulses */
    uint64_t low_us, toggle_us;
    unsigned toggles; /* even: the line is at rest */
    uint64_t break_us;
};

/* wheels.c: the line, what is written, and how it is stopped. */
bool port_open(struct port *port, const char *path, unsigned baud, bool is_quiet);
void port_close(struct port *port);
void port_lost(struct port *port, const char *word);
void port_write(struct port *port, const uint8_t *bytes, size_t length);
void port_flush(struct port *port);
void port_stop(struct port *port, const char *word);
void port_step(struct port *port);

/* dispatch.c */
void port_message(struct port *port, const uint8_t *bytes, size_t length);
void port_say(struct port *port, char tag, const char *word);
void port_fail(struct port *port, const char *word, const char *detail);
void port_pulse(struct port *port, uint64_t now_us);

/* loop.c */
/* `priority': how soon the computer lets it run. */
int port_run(const char *priority);
/* pty.c */
int pty_run(const char *link);

#endif
