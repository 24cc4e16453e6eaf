/* What all timers share: one line per question on standard input, one line per answer on standard output.
 *
 * Question: MODEL-FILE OPERATION STATES-FILE REPETITIONS
 * Answer:   "NS CHECKSUM" for REPETITIONS > 0: thread CPU time of a call, and the sum of the last call's results;
 *           "result X X ..." for REPETITIONS <= 0: the results at state -REPETITIONS;
 *           "unsupported", or "error: REASON".
 * States:   "COUNT NQ NV", then q, v, tau, a of each state; calls cycle through them.
 */
#ifndef PHIPSI_SPEED_PROTOCOL_H
#define PHIPSI_SPEED_PROTOCOL_H

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  int count, nq, nv;
  double *q, *v, *tau, *a;
} States;

/* An algorithm: one call at a state; its results in the order of the program's own coordinates, matrices by rows. */
typedef struct {
  const char *name;
  void (*call)(int state);
  long (*result)(double *out);
} Operation;

/* What each program provides. `open_model` and `use_states` return NULL, or what is wrong. */
extern const Operation operations[];
const char *open_model(const char *file);
const char *use_states(const States *states);
long largest_result(void);

static double thread_time_ns(void) {
  struct timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

static double *row(FILE *file, int n, double *to) {
  for (int i = 0; i < n; i++)
    if (fscanf(file, "%lf", to + i) != 1) return NULL;
  return to;
}

static const char *read_states(const char *name, States *s) {
  FILE *file = fopen(name, "r");
  if (!file) return "cannot open the states";
  free(s->q);
  memset(s, 0, sizeof *s);
  if (fscanf(file, "%d %d %d", &s->count, &s->nq, &s->nv) != 3 || s->count < 1) {
    fclose(file);
    return "the states lack their header";
  }
  size_t count = (size_t)s->count, nq = (size_t)s->nq, nv = (size_t)s->nv;
  s->q = (double *)malloc(count * (nq + 3 * nv) * sizeof(double));
  s->v = s->q + count * nq, s->tau = s->v + count * nv, s->a = s->tau + count * nv;
  int whole = 1;
  for (int i = 0; i < s->count && whole; i++)
    whole = row(file, s->nq, s->q + (size_t)i * nq) && row(file, s->nv, s->v + (size_t)i * nv) &&
            row(file, s->nv, s->tau + (size_t)i * nv) && row(file, s->nv, s->a + (size_t)i * nv);
  fclose(file);
  return whole ? NULL : "the states end early";
}

static void answer(const Operation *operation, const States *s, long repetitions, double *out) {
  if (repetitions <= 0) {
    operation->call((int)((-repetitions) % s->count));
    long n = operation->result(out);
    printf("result");
    for (long i = 0; i < n; i++) printf(" %.17g", out[i]);
    printf("\n");
    return;
  }
  int state = 0;
  double begun = thread_time_ns();
  for (long i = 0; i < repetitions; i++) {
    operation->call(state);
    state = state + 1 == s->count ? 0 : state + 1;
  }
  double ns = (thread_time_ns() - begun) / (double)repetitions, sum = 0;
  long n = operation->result(out);
  for (long i = 0; i < n; i++) sum += out[i];
  printf("%.6g %.17g\n", ns, sum);
}

int main(void) {
  static char line[8192], model[4096], name[256], file[4096], open[4096], open_states[4096];
  States states = {0, 0, 0, NULL, NULL, NULL, NULL};
  double *out = NULL;
  while (fgets(line, sizeof line, stdin)) {
    long repetitions;
    const char *wrong = NULL;
    if (sscanf(line, "%4095s %255s %4095s %ld", model, name, file, &repetitions) != 4) wrong = "four words are required";
    const Operation *operation = operations;
    while (!wrong && operation->name && strcmp(operation->name, name)) operation++;
    if (!wrong && !operation->name) {
      printf("unsupported\n");
      fflush(stdout);
      continue;
    }
    if (!wrong && strcmp(model, open)) {
      open[0] = open_states[0] = 0;
      wrong = open_model(model);
      if (!wrong) {
        strcpy(open, model);
        free(out);
        out = (double *)malloc((size_t)(largest_result() + 1) * sizeof(double));
      }
    }
    if (!wrong && strcmp(file, open_states)) {
      wrong = read_states(file, &states);
      if (!wrong) wrong = use_states(&states);
      if (!wrong) strcpy(open_states, file);
    }
    if (wrong)
      printf("error: %s\n", wrong);
    else
      answer(operation, &states, repetitions, out);
    fflush(stdout);
  }
  free(out);
  free(states.q);
  return 0;
}

#ifdef __cplusplus
}
#endif
#endif
