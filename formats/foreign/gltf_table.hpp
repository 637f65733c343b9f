/* gltf_table.hpp: one object of the JSON, as simdjson has it, to one line of a table. */
#ifndef PBS_GLTF_TABLE_HPP
#define PBS_GLTF_TABLE_HPP

#include "formats/foreign/gltf_doc.hpp"
#include <cstring>
#include <simdjson.h>

namespace pbs::gltf {

typedef simdjson::dom::element json_value;
typedef simdjson::dom::object json_object;

class table {
  public:
    table(document &doc, pbs_run *run, pbs_err *err)
        : doc_(doc), err_(err), samplers_(run, "the animations", err) {}
    /* i: the place in the file, for messages. */
    void add_view(json_object o, size_t i);
    void add_accessor(json_object o, size_t i);
    void add_mesh(json_object o, size_t i);
    void add_node(json_object o, size_t i);
    void add_scene(json_object o);
    /* Then its samplers, then its channels. */
    void begin_animation() { samplers_.clear(); }
    void add_sampler(json_object o);
    void add_channel(json_object o);

  private:
    void add_meshopt(json_object o, view_entry &v);
    void add_sparse(json_object o, accessor_entry &a);
    void add_primitive(json_object o);
    void add_attributes(json_object list, const json_object *draco);
    void add_children(json_object o, node_entry &n);
    void add_numbers(json_object o, const char *key, path p, node_entry &n);
    void add_instancing(json_object o, node_entry &n);

    /* A member; a wrong kind of value is an error of the file, null is not there. */
    int32_t index(json_object o, const char *key, int32_t otherwise = absent);
    uint64_t size(json_object o, const char *key, uint64_t otherwise = 0);
    uint32_t name(json_object o);
    bool object(json_object o, const char *key, json_object &out);
    bool extension(json_object o, const char *key, json_object &out);

    struct sampler_entry {
        int32_t input, output;
        uint8_t way;
    };
    document &doc_;
    pbs_err *err_;
    list<sampler_entry> samplers_;
};

} // namespace pbs::gltf
#endif
