// The least that a client can do: blocking reads of RTDE states, nothing decoded but time and number. What a driver adds to it is its
// own. Usage: rtde_reader HOST HZ SECONDS NAMES; prints one line of JSON.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

static double now_s() {
    timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return time.tv_sec + time.tv_nsec * 1e-9;
}

static void ask(int line, char type, const std::string& payload) {
    std::string frame;
    const size_t size = payload.size() + 3;
    frame += char(size >> 8);
    frame += char(size);
    frame += type;
    frame += payload;
    if (write(line, frame.data(), frame.size()) < 0) exit(1);
    unsigned char head[3];
    if (recv(line, head, 3, MSG_WAITALL) != 3) exit(1);
    std::vector<char> rest((head[0] << 8 | head[1]) - 3);
    if (recv(line, rest.data(), rest.size(), MSG_WAITALL) != ssize_t(rest.size())) exit(1);
}

template <typename T>
static T field(const unsigned char* from) {
    unsigned char bytes[sizeof(T)];
    std::reverse_copy(from, from + sizeof(T), bytes);
    T value;
    memcpy(&value, bytes, sizeof(T));
    return value;
}

int main(int, char** words) {
    const double hz = atof(words[2]), seconds = atof(words[3]);
    const int number_at = atoi(words[5]);  // bytes from the first field to output_int_register_2
    const int line = socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(30004);
    inet_pton(AF_INET, words[1], &address.sin_addr);
    if (connect(line, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0) return 1;
    const int on = 1;
    setsockopt(line, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    ask(line, 'V', std::string("\0\2", 2));
    std::string rate(8, 0);
    memcpy(&rate[0], &hz, 8);
    std::reverse(rate.begin(), rate.end());
    ask(line, 'O', rate + words[4]);
    ask(line, 'S', "");

    const double warm_up_s = 0.3;
    std::vector<unsigned char> inbox(1 << 17);
    std::vector<double> latencies_us;
    size_t filled = 0;
    int first = 0, last = 0;
    long taken = 0;
    double began_s = 0, counted_s = 0;
    while (counted_s < seconds) {
        const ssize_t got = recv(line, inbox.data() + filled, inbox.size() - filled, 0);
        if (got <= 0) return 1;
        filled += got;
        size_t used = 0;
        while (filled - used >= 3) {
            const size_t size = inbox[used] << 8 | inbox[used + 1];
            if (filled - used < size) break;
            const unsigned char* fields = inbox.data() + used + 4;
            const double now = now_s();
            if (began_s == 0) began_s = now;
            counted_s = now - began_s - warm_up_s;
            if (counted_s >= 0) {
                latencies_us.push_back((now - field<double>(fields)) * 1e6);
                last = field<int32_t>(fields + number_at);
                if (taken++ == 0) first = last;
            }
            used += size;
        }
        memmove(inbox.data(), inbox.data() + used, filled - used);
        filled -= used;
    }
    std::sort(latencies_us.begin(), latencies_us.end());
    const auto at = [&](double share) { return latencies_us[std::lround(share * (latencies_us.size() - 1))]; };
    printf("{\"p50\": %.1f, \"p99\": %.1f, \"p999\": %.1f, \"distinct_s\": %.0f, \"taken_s\": %.0f, \"missed\": %d}\n", at(0.5), at(0.99),
           at(0.999), taken / counted_s, taken / counted_s, last - first + 1 - int(taken));
}
