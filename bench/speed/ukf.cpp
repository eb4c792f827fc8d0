// The textbook unscented Kalman filter for one instrument, with fixed-size Eigen matrices: 9 states, 19 points.
// Constant acceleration driven by white jerk; range, azimuth, elevation together. α = 1, β = 0, κ = 3 − n.
// stdin: doubles laps, jerk_psd, sigma (3), offset (3), x (9), P (81), then t, range, azimuth, elevation per shot.
// stdout: nanoseconds per shot over all laps, then x (9) at the end of the last.
#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/LU>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <vector>

constexpr int N = 9, POINTS = 2 * N + 1;
using State = Eigen::Matrix<double, N, 1>;
using Cov = Eigen::Matrix<double, N, N>;
using Vec3 = Eigen::Vector3d;
using Points = Eigen::Matrix<double, N, POINTS>;
using Seen = Eigen::Matrix<double, 3, POINTS>;

const double W = 1.0 / 6.0, W0 = 1.0 - N / 3.0;

static double wrap(double a) { return a - 2 * M_PI * std::floor((a + M_PI) / (2 * M_PI)); }

static Points spread(const State& x, const Cov& P) {
    const Cov L = std::sqrt(3.0) * P.llt().matrixL().toDenseMatrix();
    Points points;
    points.col(0) = x;
    points.middleCols<N>(1) = L.colwise() + x;
    points.rightCols<N>() = (-L).colwise() + x;
    return points;
}

template <int M>
static Eigen::Matrix<double, M, 1> mean(const Eigen::Matrix<double, M, POINTS>& points) {
    return W0 * points.col(0) + W * points.template rightCols<POINTS - 1>().rowwise().sum();
}

static void predict(State& x, Cov& P, double dt, double psd) {
    Points points = spread(x, P);
    points.topRows<3>() += dt * points.middleRows<3>(3) + 0.5 * dt * dt * points.bottomRows<3>();
    points.middleRows<3>(3) += dt * points.bottomRows<3>();
    x = mean<N>(points);
    const Points off = points.colwise() - x;
    P = W0 * off.col(0) * off.col(0).transpose();
    P += W * off.rightCols<POINTS - 1>() * off.rightCols<POINTS - 1>().transpose();
    const double d2 = dt * dt;
    const double q[3][3] = {{d2 * d2 * dt / 20, d2 * d2 / 8, d2 * dt / 6},
                            {d2 * d2 / 8, d2 * dt / 3, d2 / 2},
                            {d2 * dt / 6, d2 / 2, dt}};
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++)
            for (int i = 0; i < 3; i++) P(3 * a + i, 3 * b + i) += psd * q[a][b];
}

static void update(State& x, Cov& P, const Vec3& z, const Vec3& sigma, const Vec3& offset) {
    const Points points = spread(x, P);
    Seen seen;
    for (int k = 0; k < POINTS; k++) {
        const Vec3 p = points.col(k).head<3>() - offset;
        const double flat = std::hypot(p[0], p[1]);
        seen.col(k) << std::hypot(flat, p[2]), std::atan2(p[0], p[1]), std::atan2(p[2], flat);
    }
    const Vec3 centre = seen.col(0);
    for (int k = 0; k < POINTS; k++) {
        seen.col(k) -= centre;
        seen(1, k) = wrap(seen(1, k));
    }
    const Vec3 middle = mean<3>(seen);
    seen.colwise() -= middle;
    const Points off = points.colwise() - x;
    Eigen::Matrix3d S = W0 * seen.col(0) * seen.col(0).transpose();
    S += W * seen.rightCols<POINTS - 1>() * seen.rightCols<POINTS - 1>().transpose();
    S.diagonal() += sigma.cwiseAbs2();
    const Eigen::Matrix<double, N, 3> C = W * off.rightCols<POINTS - 1>() * seen.rightCols<POINTS - 1>().transpose();
    const Eigen::Matrix<double, N, 3> K = C * S.inverse();
    Vec3 v = z - centre - middle;
    v[1] = wrap(v[1]);
    x += K * v;
    P -= K * S * K.transpose();
    P = 0.5 * (P + P.transpose()).eval();
}

int main() {
    std::vector<double> in;
    for (double value; std::fread(&value, sizeof value, 1, stdin) == 1;) in.push_back(value);
    const int laps = static_cast<int>(in[0]);
    const double psd = in[1];
    const Vec3 sigma(&in[2]), offset(&in[5]);
    const size_t shots = (in.size() - 98) / 4;
    State x;
    Cov P;
    const auto begin = std::chrono::steady_clock::now();
    for (int lap = 0; lap < laps; lap++) {
        x = State(&in[8]);
        P = Cov(&in[17]);
        const double* shot = &in[98];
        for (double t = shot[0]; shot < &in[98] + 4 * shots; t = shot[0], shot += 4) {
            predict(x, P, shot[0] - t, psd);
            update(x, P, Vec3(shot + 1), sigma, offset);
        }
    }
    const std::chrono::duration<double, std::nano> took = std::chrono::steady_clock::now() - begin;
    std::printf("%.17g\n", took.count() / (laps * shots));
    for (int i = 0; i < N; i++) std::printf("%.17g\n", x[i]);
}
