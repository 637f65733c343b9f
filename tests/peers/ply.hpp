/* ply.hpp: the one format in which all programs beside ours get their input and give their output:
 * binary little-endian PLY, of points with normals or of triangles. Reads what the tools here
 * write: any types of numbers, properties that nobody asked for, lists of corners. */
#ifndef PEERS_PLY_HPP
#define PEERS_PLY_HPP

#include <array>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

namespace peers {

using vec = std::array<double, 3>;

struct cloud {
    std::vector<vec> at, normal; /* normal is empty if there are none */
    std::vector<std::array<uint32_t, 3>> triangle;
};

[[noreturn]] inline void fail(const std::string &what) {
    fprintf(stderr, "%s\n", what.c_str());
    exit(65);
}

struct property {
    std::string name, type, list; /* list: the type of the count; empty for a plain number */
};
struct element {
    std::string name;
    size_t count = 0;
    std::vector<property> properties;
};

class ply_reader {
  public:
    explicit ply_reader(const char *from) : path(from), f(fopen(from, "rb")) {
        if (!f) fail(path + ": cannot be opened");
        head();
    }
    ~ply_reader() { fclose(f); }
    ply_reader(const ply_reader &) = delete;
    ply_reader &operator=(const ply_reader &) = delete;

    cloud read() {
        cloud c;
        for (const element &e : elements) {
            if (e.name == "vertex")
                vertices(e, c);
            else if (e.name == "face")
                faces(e, c);
        }
        return c;
    }

  private:
    std::string path;
    FILE *f;
    std::vector<element> elements;

    [[noreturn]] void bad(const char *why) { fail(path + ": " + why); }
    void head() {
        char line[1024], a[64], b[64], c[64], d[64];
        while (fgets(line, sizeof line, f) && strncmp(line, "end_header", 10)) {
            element e;
            if (!strncmp(line, "format", 6) && !strstr(line, "binary_little_endian"))
                bad("not binary PLY");
            if (sscanf(line, "element %63s %zu", a, &e.count) == 2)
                e.name = a, elements.push_back(e);
            else if (sscanf(line, "property list %63s %63s %63s", b, c, d) == 3)
                elements.back().properties.push_back({d, c, b});
            else if (sscanf(line, "property %63s %63s", a, b) == 2)
                elements.back().properties.push_back({b, a, ""});
        }
    }
    double number(const std::string &type) {
        if (type == "float" || type == "float32") return raw<float>();
        if (type == "double" || type == "float64") return raw<double>();
        if (type == "uchar" || type == "uint8") return raw<uint8_t>();
        if (type == "char" || type == "int8") return raw<int8_t>();
        if (type == "ushort" || type == "uint16") return raw<uint16_t>();
        if (type == "short" || type == "int16") return raw<int16_t>();
        if (type == "uint" || type == "uint32") return raw<uint32_t>();
        if (type == "int" || type == "int32") return raw<int32_t>();
        bad("a type of numbers that PLY does not have");
    }
    template <class T> double raw() {
        T v;
        if (fread(&v, sizeof v, 1, f) != 1) bad("ends too early");
        return (double)v;
    }
    void vertices(const element &e, cloud &c) {
        static const char *const names[6] = {"x", "y", "z", "nx", "ny", "nz"};
        std::vector<int> to;
        bool normals = false;
        for (const property &p : e.properties) {
            int k = 0;
            while (k < 6 && p.name != names[k]) k++;
            to.push_back(k < 6 ? k : 6);
            normals |= k == 3;
        }
        for (size_t i = 0; i < e.count; i++) {
            double v[7] = {0};
            for (size_t k = 0; k < to.size(); k++) v[to[k]] = number(e.properties[k].type);
            c.at.push_back({v[0], v[1], v[2]});
            if (normals) c.normal.push_back({v[3], v[4], v[5]});
        }
    }
    void faces(const element &e, cloud &c) {
        for (size_t i = 0; i < e.count; i++)
            for (const property &p : e.properties) {
                size_t n = p.list.empty() ? 1 : (size_t)number(p.list);
                std::array<uint32_t, 3> t{};
                for (size_t k = 0; k < n; k++) {
                    uint32_t v = (uint32_t)number(p.type);
                    if (k < 3) t[k] = v;
                }
                if (n == 3 && p.name.compare(0, 6, "vertex") == 0) c.triangle.push_back(t);
            }
    }
};

inline cloud read_ply(const char *path) {
    return ply_reader(path).read();
}

inline void write_ply(const char *path, const cloud &c) {
    FILE *f = fopen(path, "wb");
    if (!f) fail(std::string(path) + ": cannot be made");
    fprintf(f, "ply\nformat binary_little_endian 1.0\nelement vertex %zu\n", c.at.size());
    fprintf(f, "property float x\nproperty float y\nproperty float z\n");
    bool normals = !c.normal.empty();
    if (normals) fprintf(f, "property float nx\nproperty float ny\nproperty float nz\n");
    if (!c.triangle.empty())
        fprintf(f, "element face %zu\nproperty list uchar uint vertex_indices\n",
                c.triangle.size());
    fprintf(f, "end_header\n");
    for (size_t i = 0; i < c.at.size(); i++) {
        float v[6];
        for (int k = 0; k < 3; k++) v[k] = (float)c.at[i][k];
        for (int k = 0; k < 3 && normals; k++) v[3 + k] = (float)c.normal[i][k];
        fwrite(v, sizeof *v, normals ? 6 : 3, f);
    }
    for (const auto &t : c.triangle) fputc(3, f), fwrite(t.data(), 4, 3, f);
    if (fclose(f)) fail(std::string(path) + ": cannot be written");
}

} // namespace peers
#endif
