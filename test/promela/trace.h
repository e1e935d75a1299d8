/* The facts of a trace, as data: one a line, five numbers each. A generated process of many sends would not
   compile in minutes; data of any length take no time. */
#include <stdio.h>
#include <stdlib.h>

static int (*trace_facts)[5];
static int trace_length;
static int trace_furthest;

static void load(void)
{
	FILE *file = fopen("trace.txt", "r");
	int room = 1024, n = 0;

	trace_facts = malloc(room * sizeof *trace_facts);
	while (file && fscanf(file, "%d %d %d %d %d", &trace_facts[n][0], &trace_facts[n][1], &trace_facts[n][2],
			&trace_facts[n][3], &trace_facts[n][4]) == 5)
		if (++n == room)
			trace_facts = realloc(trace_facts, (room *= 2) * sizeof *trace_facts);
	trace_length = n;
}

/* How far any way through the model has come is no part of its state. */
static void came_to(int n)
{
	if (n > trace_furthest)
		printf("reached %d\n", trace_furthest = n);
}
