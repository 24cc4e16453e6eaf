/* MuJoCo on a compiled model without constraints: the driver has switched contacts, limits, friction and sensors off. */
#include "protocol.h"

#include <mujoco/mujoco.h>

static mjModel *model;
static mjData *data;
static const States *states;

const char *open_model(const char *file) {
  mj_deleteData(data), mj_deleteModel(model);
  data = NULL;
  model = mj_loadModel(file, NULL);
  if (!model) return "MuJoCo cannot load the model";
  data = mj_makeData(model);
  return data ? NULL : "MuJoCo has no memory for the model";
}

const char *use_states(const States *s) {
  states = s;
  return s->nq == model->nq && s->nv == model->nv ? NULL : "the states have other dimensions than the model";
}

long largest_result(void) { return (long)model->nv * model->nv; }

static void set(mjtNum *to, const double *from, int n, int state) {
  memcpy(to, from + (size_t)state * (size_t)n, (size_t)n * sizeof *to);
}

static void forward(int i) {
  set(data->qpos, states->q, states->nq, i);
  set(data->qvel, states->v, states->nv, i);
  set(data->qfrc_applied, states->tau, states->nv, i);
  mj_forward(model, data);
}

static void inverse(int i) {
  set(data->qpos, states->q, states->nq, i);
  set(data->qvel, states->v, states->nv, i);
  set(data->qacc, states->a, states->nv, i);
  mj_inverse(model, data);
}

static void mass_matrix(int i) {
  set(data->qpos, states->q, states->nq, i);
  mj_kinematics(model, data);
  mj_comPos(model, data);
  mj_makeM(model, data);
}

static long copy(double *out, const mjtNum *from) {
  memcpy(out, from, (size_t)model->nv * sizeof *out);
  return model->nv;
}

static long accelerations(double *out) { return copy(out, data->qacc); }
static long forces(double *out) { return copy(out, data->qfrc_inverse); }
static long dense(double *out) {
  mj_fullM(model, data, out);
  return (long)model->nv * model->nv;
}

const Operation operations[] = {
    {"forward_dynamics", forward, accelerations},
    {"inverse_dynamics", inverse, forces},
    {"mass_matrix", mass_matrix, dense},
    {NULL, NULL, NULL},
};
