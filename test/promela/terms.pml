/* Terms of path planning: who may lead, and who may assign. Driven by the facts of a trace as lock.pml is:
   kind, number of the term in the order of terms, robot; the others are not used. A leader whose votes have
   ended, since it stands still or is cut off, may think that it leads beside the next one, but assigns
   nothing any more. One that was late, or is out of time, claims anew, and with that leads no longer. */

c_decl { \#include "trace.h" };

#define CLAIMS   1	/* asks for votes in this term */
#define LEADS    2	/* has them */
#define ASSIGNS  3	/* coordinates: knows all places, or gives a path away */
#define STEPS_DOWN 4
#define CRASHED  5

#define ROBOTS 32

int at = 0;
int kind, term, robot;

int claimed[ROBOTS];	/* the last term that each robot has asked votes for */
int leads[ROBOTS];	/* the term in which each thinks that it leads */
int latest = 0;		/* the highest term that was won, and by whom */
int leader = 0;

active proctype Model()
{
	c_code { load(); };
	do
	:: c_expr { now.at < trace_length } ->
		c_code {
			came_to(now.at);
			now.kind = trace_facts[now.at][0];
			now.term = trace_facts[now.at][1];
			now.robot = trace_facts[now.at][3];
		};
		if
		:: kind == CLAIMS && term > claimed[robot] -> claimed[robot] = term; leads[robot] = 0
		:: kind == LEADS && term == claimed[robot] && term > latest && leads[robot] == 0 ->
			leads[robot] = term; latest = term; leader = robot
		:: kind == ASSIGNS && leader == robot && leads[robot] == latest && latest != 0 &&
			(term == latest || term == 0) -> skip
		:: kind == STEPS_DOWN && leads[robot] == term && term != 0 -> leads[robot] = 0
		:: kind == CRASHED -> leads[robot] = 0
		fi;
		at++
	:: c_expr { now.at == trace_length } ->
		c_code { came_to(now.at); };
		assert(false)
	od
}
