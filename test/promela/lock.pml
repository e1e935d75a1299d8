/* Mutual exclusion by tokens, for one token: what its home and its owners may say, one after the other.

   The model is driven by the facts of a trace (trace.h): kind, number of the hold, number of its hand-over,
   robot, time (ms; of LEASED: until when, at least). A fact that it does not allow blocks it. One step is
   hidden: a robot that stands still does not know that its lease has run out; then another may hold the
   token. The verifier tries with that step and without, at every fact. It reports the assertion at the end
   as violated if the trace is accepted. */

c_decl { \#include "trace.h" };

#define GRANTED  1	/* the home: this hand-over counts, for this robot */
#define LEASED   2	/* the robot: the hold lasts until then */
#define ACQUIRED 3
#define RELEASED 4
#define LOST     5	/* the robot: its lease has run out */
#define CRASHED  6

#define ROBOTS 32

int at = 0;
int kind, hold, hand, robot, time;

int granted = 0;	/* the last hand-over, and to whom */
int owner = 0;
int holder = 0;		/* who holds the token, by which number, and until when at least */
int held = 0;
int until = 0;
int told = 0;		/* the lease that was told last, and by whom */
int tells = 0;
int last = 0;		/* the number of the last hold */
int past[ROBOTS];	/* holds that have run out, of which their robots do not know */

active proctype Model()
{
	c_code { load(); };
	do
	:: c_expr { now.at < trace_length } ->
		c_code {
			came_to(now.at);
			now.kind = trace_facts[now.at][0];
			now.hold = trace_facts[now.at][1];
			now.hand = trace_facts[now.at][2];
			now.robot = trace_facts[now.at][3];
			now.time = trace_facts[now.at][4];
		};
		if
		:: kind != LEASED && kind != ACQUIRED && holder != 0 && time >= until -> goto expires
		:: kind == ACQUIRED && holder != 0 && time >= until -> goto expires
		:: kind == GRANTED && (hand > granted || (hand == granted && robot == owner)) ->
			granted = hand; owner = robot
		:: kind == LEASED && holder == robot && held == hold -> until = time
		:: kind == LEASED && !(holder == robot && held == hold) ->
			told = time; tells = robot
		:: kind == ACQUIRED && holder == 0 && hold > last && hand == granted &&
			robot == owner && tells == robot ->
			holder = robot; held = hold; last = hold; until = told
		:: kind == RELEASED && holder == robot && held == hold -> holder = 0
		:: kind == LOST && holder == robot && held == hold -> holder = 0
		:: kind == LOST && past[robot] == hold -> past[robot] = 0
		:: kind == CRASHED ->
			past[robot] = 0;
			if
			:: holder == robot -> holder = 0
			:: else -> skip
			fi
		fi;
		at++;
		goto next;
expires:	past[holder] = held; holder = 0;
next:		skip
	:: c_expr { now.at == trace_length } ->
		c_code { came_to(now.at); };
		assert(false)
	od
}
