// The paper's scheme as an engineer would write it for one sample: average acceleration, the step
// halved at every transition, the inverse of each stick pattern and step kept once it is known.
// newmark PROBLEM HALVINGS (at most 20); PROBLEM as problem.py writes it.
// Prints the CPU seconds of the march, then the slip fractions, then the displacements at every 100th step.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <vector>

constexpr int n = 5, stride = 100;

struct Problem {
    int steps;
    double dt, contact, limit;
    double stiffness[n][n], damping[n][n];
    std::vector<double> force;
};

struct State {
    double x[n] = {}, v[n] = {}, a[n] = {}, slider[n] = {};
    int way[n] = {};
};

struct Inverse {
    bool is_known = false;
    double m[n][n];
};

static Inverse inverses[21][1 << n];  // halvings left, stick pattern

// Gauss-Jordan; the matrix is symmetric and positive definite
static void invert(double m[n][n]) {
    for (int k = 0; k < n; ++k) {
        double pivot = 1 / m[k][k];
        m[k][k] = 1.0;
        for (int c = 0; c < n; ++c) m[k][c] *= pivot;
        for (int r = 0; r < n; ++r) {
            if (r == k) continue;
            double f = m[r][k];
            m[r][k] = 0.0;
            for (int c = 0; c < n; ++c) m[r][c] -= f * m[k][c];
        }
    }
}

static const Inverse &inverse(const Problem &p, const State &s, double h, int left) {
    int pattern = 0;
    for (int i = 0; i < n; ++i) pattern |= (s.way[i] == 0) << i;
    Inverse &kept = inverses[left][pattern];
    if (kept.is_known) return kept;
    for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j) {
            kept.m[i][j] = p.stiffness[i][j] + 2 / h * p.damping[i][j];
            if (i == j) kept.m[i][j] += 4 / (h * h) + (s.way[i] ? 0.0 : p.contact);
        }
    invert(kept.m);
    kept.is_known = true;
    return kept;
}

static void accelerate(const Problem &p, State &s, double force) {
    for (int i = 0; i < n; ++i) {
        double sum = s.way[i] ? s.way[i] * p.limit : p.contact * (s.x[i] - s.slider[i]);
        for (int j = 0; j < n; ++j) sum += p.stiffness[i][j] * s.x[j] + p.damping[i][j] * s.v[j];
        s.a[i] = (i == n - 1 ? force : 0.0) - sum;
    }
}

static State trial(const Problem &p, const State &s, double h, int left, double force) {
    const Inverse &solve = inverse(p, s, h, left);
    double b[n];
    for (int i = 0; i < n; ++i) {
        b[i] = 4 / (h * h) * s.x[i] + 4 / h * s.v[i] + s.a[i];
        b[i] -= s.way[i] ? s.way[i] * p.limit : -p.contact * s.slider[i];
        for (int j = 0; j < n; ++j) b[i] += p.damping[i][j] * (2 / h * s.x[j] + s.v[j]);
    }
    b[n - 1] += force;
    State e = s;
    for (int i = 0; i < n; ++i) {
        e.x[i] = 0.0;
        for (int j = 0; j < n; ++j) e.x[i] += solve.m[i][j] * b[j];
        e.v[i] = 2 / h * (e.x[i] - s.x[i]) - s.v[i];
        e.a[i] = 4 / (h * h) * (e.x[i] - s.x[i]) - 4 / h * s.v[i] - s.a[i];
    }
    return e;
}

static bool switches(const Problem &p, const State &e, int i) {
    if (e.way[i]) return e.way[i] * e.v[i] < 0.0;
    return std::abs(p.contact * (e.x[i] - e.slider[i])) > p.limit;
}

static void advance(const Problem &p, State &s, double h, int left, double f0, double f1, double *slip) {
    State e = trial(p, s, h, left, f1);
    bool any = false;
    for (int i = 0; i < n; ++i) any = any || switches(p, e, i);
    if (any && left > 0) {
        double middle = 0.5 * (f0 + f1);
        advance(p, s, h / 2, left - 1, f0, middle, slip);
        advance(p, s, h / 2, left - 1, middle, f1, slip);
        return;
    }
    for (int i = 0; i < n; ++i)
        if (s.way[i]) slip[i] += h;
    s = e;
    if (!any) return;
    for (int i = 0; i < n; ++i) {
        if (!switches(p, e, i)) continue;
        if (s.way[i]) {
            s.slider[i] = s.x[i] - s.way[i] * p.limit / p.contact;
            s.way[i] = 0;
        } else {
            s.way[i] = s.x[i] > s.slider[i] ? 1 : -1;
        }
    }
    accelerate(p, s, f1);
}

int main(int, char **argument) {
    Problem p;
    FILE *file = std::fopen(argument[1], "r");
    if (!file || std::fscanf(file, "%d %lf %lf %lf", &p.steps, &p.dt, &p.contact, &p.limit) != 4) return 1;
    for (auto &row : p.stiffness)
        for (double &k : row)
            if (std::fscanf(file, "%lf", &k) != 1) return 1;
    for (auto &row : p.damping)
        for (double &c : row)
            if (std::fscanf(file, "%lf", &c) != 1) return 1;
    p.force.resize(p.steps + 1);
    for (double &f : p.force)
        if (std::fscanf(file, "%lf", &f) != 1) return 1;
    std::fclose(file);

    State s;
    double slip[n] = {};
    std::vector<double> history;
    int halvings = std::atoi(argument[2]);
    std::clock_t begin = std::clock();
    accelerate(p, s, p.force[0]);
    for (int k = 0; k < p.steps; ++k) {
        advance(p, s, p.dt, halvings, p.force[k], p.force[k + 1], slip);
        if ((k + 1) % stride == 0) history.insert(history.end(), s.x, s.x + n);
    }
    std::printf("%.9g\n", double(std::clock() - begin) / CLOCKS_PER_SEC);
    for (int i = 0; i < n; ++i) std::printf("%.17g ", slip[i] / (p.dt * p.steps));
    for (std::size_t k = 0; k < history.size(); ++k) std::printf(k % n ? " %.17g" : "\n%.17g", history[k]);
    std::printf("\n");
}
