// The peer ur_kin.cpp (ros-industrial/universal_robot) on the poses that `cargo bench -p arthro-motion --bench kinematics`
// wrote: `ur_kin_peer POSES SOLUTIONS` prints the time of forward and inverse kinematics in ns, the best of many rounds, and
// writes for each pose eight rows of joints, NaN where there is no solution. Compiled with -DUR5_PARAMS -DIKFAST_NO_MAIN
// together with ur_kin.cpp. The poses are those of its own forward kinematics: its frames differ from ours by constant turns.
#include <ur_kinematics/ur_kin.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <limits>
#include <vector>

using Clock = std::chrono::steady_clock;

namespace {
const size_t kRow = 18;      // joints, rotation, origin
const size_t kBlock = 4096;  // poses of one round

template <typename Ask>
double best_ns(size_t poses, Ask ask) {
    double best = std::numeric_limits<double>::infinity();
    for (int round = 0; round < 20; ++round) {
        for (size_t block = 0; block + kBlock <= poses; block += kBlock) {
            const auto began = Clock::now();
            for (size_t i = block; i < block + kBlock; ++i) ask(i);
            const std::chrono::duration<double, std::nano> took = Clock::now() - began;
            best = std::fmin(best, took.count() / kBlock);
        }
    }
    return best;
}
}  // namespace

int main(int count, char** arguments) {
    if (count != 3) {
        std::fprintf(stderr, "usage: ur_kin_peer POSES SOLUTIONS\n");
        return 2;
    }
    std::ifstream file(arguments[1], std::ios::binary);
    const std::vector<char> bytes((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
    const double* rows = reinterpret_cast<const double*>(bytes.data());
    const size_t poses = bytes.size() / sizeof(double) / kRow;
    std::vector<double> transforms(poses * 16);
    std::vector<double> solutions(poses * 48, std::nan(""));
    const double forward_ns =
        best_ns(poses, [&](size_t i) { ur_kinematics::forward(rows + i * kRow, &transforms[i * 16]); });
    double joints[48];
    volatile int sink = 0;
    const double inverse_ns = best_ns(poses, [&](size_t i) {
        sink = sink + ur_kinematics::inverse(&transforms[i * 16], joints, rows[i * kRow + 5]);
    });
    for (size_t i = 0; i < poses; ++i) {
        ur_kinematics::forward(rows + i * kRow, &transforms[i * 16]);
        const int found = ur_kinematics::inverse(&transforms[i * 16], joints, rows[i * kRow + 5]);
        for (int k = 0; k < found * 6; ++k) solutions[i * 48 + k] = joints[k];
    }
    std::ofstream(arguments[2], std::ios::binary)
        .write(reinterpret_cast<const char*>(solutions.data()),
               static_cast<std::streamsize>(solutions.size() * sizeof(double)));
    std::printf("%.1f %.1f\n", forward_ns, inverse_ns);
    return 0;
}
