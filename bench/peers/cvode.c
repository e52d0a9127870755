/* SUNDIALS' CVODE with its root finder, one sample: Adams-Moulton, started anew at every transition,
   stopping at every force sample. cvode PROBLEM TOLERANCE; PROBLEM and output as in newmark.cpp. */
#include <cvode/cvode.h>
#include <math.h>
#include <nvector/nvector_serial.h>
#include <stdio.h>
#include <stdlib.h>
#include <sunnonlinsol/sunnonlinsol_fixedpoint.h>
#include <time.h>

enum { n = 5, stride = 100 };

struct problem {
    int steps, way[n];
    double dt, contact, limit, stiffness[n][n], damping[n][n], slider[n];
    double f0, slope, t0;
    double *force;
};

static int rate(realtype t, N_Vector y, N_Vector derivative, void *data) {
    const struct problem *p = data;
    const double *x = N_VGetArrayPointer(y), *v = x + n;
    double *d = N_VGetArrayPointer(derivative);
    for (int i = 0; i < n; ++i) {
        double sum = p->way[i] ? p->way[i] * p->limit : p->contact * (x[i] - p->slider[i]);
        for (int j = 0; j < n; ++j) sum += p->stiffness[i][j] * x[j] + p->damping[i][j] * v[j];
        d[i] = v[i];
        d[n + i] = -sum;
    }
    d[2 * n - 1] += p->f0 + p->slope * (t - p->t0);
    return 0;
}

static int guards(realtype t, N_Vector y, realtype *g, void *data) {
    const struct problem *p = data;
    const double *x = N_VGetArrayPointer(y), *v = x + n;
    (void)t;
    for (int i = 0; i < n; ++i)
        g[i] = p->way[i] ? p->way[i] * v[i] : p->limit - p->contact * fabs(x[i] - p->slider[i]);
    return 0;
}

int main(int count, char **argument) {
    struct problem p = {0};
    FILE *file = count > 2 ? fopen(argument[1], "r") : NULL;
    if (!file || fscanf(file, "%d %lf %lf %lf", &p.steps, &p.dt, &p.contact, &p.limit) != 4) return 1;
    for (int i = 0; i < n * n; ++i)
        if (fscanf(file, "%lf", &p.stiffness[0][i]) != 1) return 1;
    for (int i = 0; i < n * n; ++i)
        if (fscanf(file, "%lf", &p.damping[0][i]) != 1) return 1;
    p.force = malloc((p.steps + 1) * sizeof *p.force);
    for (int i = 0; i <= p.steps; ++i)
        if (fscanf(file, "%lf", &p.force[i]) != 1) return 1;
    fclose(file);

    double tolerance = atof(argument[2]), slip[n] = {0}, since[n] = {0};
    double *history = malloc(p.steps / stride * n * sizeof *history);
    SUNContext context;
    SUNContext_Create(NULL, &context);
    N_Vector y = N_VNew_Serial(2 * n, context);
    N_VConst(0.0, y);
    double *x = N_VGetArrayPointer(y), *v = x + n;
    void *solver = CVodeCreate(CV_ADAMS, context);
    clock_t begin = clock();
    CVodeInit(solver, rate, 0.0, y);
    CVodeSStolerances(solver, tolerance, 1e-2 * tolerance);
    CVodeSetUserData(solver, &p);
    CVodeSetNonlinearSolver(solver, SUNNonlinSol_FixedPoint(y, 0, context));
    CVodeRootInit(solver, n, guards);
    CVodeSetNoInactiveRootWarn(solver);
    double t = 0.0;
    for (int k = 0; k < p.steps; ++k) {
        double end = (k + 1) * p.dt;
        p.t0 = k * p.dt;
        p.f0 = p.force[k];
        p.slope = (p.force[k + 1] - p.force[k]) / p.dt;
        while (t < end) {
            int found[n];
            CVodeSetStopTime(solver, end);
            int flag = CVode(solver, end, y, &t, CV_NORMAL);
            if (flag < 0) return 1;
            if (flag != CV_ROOT_RETURN) continue;
            CVodeGetRootInfo(solver, found);
            for (int i = 0; i < n; ++i) {
                if (found[i] >= 0) continue; /* a transition is a guard that falls through zero */
                if (p.way[i]) {
                    p.slider[i] = x[i] - p.way[i] * p.limit / p.contact;
                    p.way[i] = 0;
                    v[i] = 0.0;
                    slip[i] += t - since[i];
                } else {
                    p.way[i] = x[i] > p.slider[i] ? 1 : -1;
                    since[i] = t;
                }
            }
            CVodeReInit(solver, t, y);
        }
        if ((k + 1) % stride == 0)
            for (int i = 0; i < n; ++i) history[(k + 1) / stride * n - n + i] = x[i];
    }
    for (int i = 0; i < n; ++i)
        if (p.way[i]) slip[i] += t - since[i];
    printf("%.9g\n", (double)(clock() - begin) / CLOCKS_PER_SEC);
    for (int i = 0; i < n; ++i) printf("%.17g ", slip[i] / (p.dt * p.steps));
    for (int k = 0; k < p.steps / stride * n; ++k) printf(k % n ? " %.17g" : "\n%.17g", history[k]);
    printf("\n");
    return 0;
}
