// nanoflann's k-d tree as a rival of benches/photon_map.rs, which compiles and runs this.
//
// Reads from standard input, as the machine stores them: the number of points (u64) and their coordinates (f32), then any
// number of tasks: how many queries (u64), k (u64), the queries' coordinates (f32). Answers each task with the processor
// time of this thread in seconds and the sum of the squared distances of the k-th neighbours (f64 both).
#include <cstdint>
#include <cstdio>
#include <ctime>
#include <vector>

#include <nanoflann.hpp>

struct Points {
    std::vector<float> at;
    size_t kdtree_get_point_count() const { return at.size() / 3; }
    float kdtree_get_pt(size_t i, size_t axis) const { return at[3 * i + axis]; }
    template <class Box>
    bool kdtree_get_bbox(Box &) const {
        return false;
    }
};

using Tree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, Points>, Points, 3, uint32_t>;

template <class T>
bool read(T *to, size_t count) {
    return fread(to, sizeof(T), count, stdin) == count;
}

double thread_seconds() {
    timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

int main() {
    uint64_t task[2];
    if (!read(task, 1)) return 1;
    Points points;
    points.at.resize(3 * task[0]);
    if (!read(points.at.data(), points.at.size())) return 1;
    Tree tree(3, points, nanoflann::KDTreeSingleIndexAdaptorParams());
    tree.buildIndex();

    std::vector<float> queries;
    while (read(task, 2)) {
        queries.resize(3 * task[0]);
        if (!read(queries.data(), queries.size())) return 1;
        std::vector<uint32_t> index(task[1]);
        std::vector<float> d_sq(task[1]);
        double answer[2] = {thread_seconds(), 0.0};
        for (size_t i = 0; i < task[0]; i++) {
            tree.knnSearch(&queries[3 * i], task[1], index.data(), d_sq.data());
            answer[1] += double(d_sq[task[1] - 1]);
        }
        answer[0] = thread_seconds() - answer[0];
        fwrite(answer, sizeof(double), 2, stdout);
        fflush(stdout);
    }
}
