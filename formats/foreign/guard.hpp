/* guard.hpp: between C++ and C: no exception leaves a module, and memory is counted by the run.
 *
 * Inside a module an error is thrown as a failure, whose text is in the caller's pbs_err already.
 * guard() around the body of every exported function turns it, and whatever a library throws,
 * back into a pbs_code. */
#ifndef PBS_GUARD_HPP
#define PBS_GUARD_HPP

#include "libcore/ground/err.h"
#include "libcore/ground/run.h"
#include <cstdarg>
#include <cstdio>
#include <exception>
#include <new>
#include <utility>

namespace pbs {

struct failure {
    pbs_code code;
};

inline void check(pbs_code rc) {
    if (rc) throw failure{rc};
}

[[noreturn]] __attribute__((format(printf, 3, 4), cold)) inline void
fail(pbs_err *err, pbs_code code, const char *fmt, ...) {
    char text[sizeof err->text];
    va_list ap;
    va_start(ap, fmt);
    vsnprintf(text, sizeof text, fmt, ap);
    va_end(ap);
    throw failure{pbs_fail(err, code, "%s", text)};
}

/* A library that throws dislikes its input: PBS_DATA, in its own words. */
template <class F> pbs_code guard(pbs_err *err, F body) noexcept {
    try {
        body();
        return PBS_OK;
    } catch (const failure &e) {
        return e.code;
    } catch (const std::bad_alloc &) {
        return pbs_fail(err, PBS_LIMIT, "the machine has no memory left");
    } catch (const std::exception &e) {
        return pbs_fail(err, PBS_DATA, "%s", e.what());
    } catch (...) {
        return pbs_fail(err, PBS_INTERNAL, "an exception of unknown kind");
    }
}

/* An array of plain values from pbs_alloc. */
template <class T> class array {
  public:
    array() = default;
    array(pbs_run *run, size_t count, const char *what, pbs_err *err) : run_(run), size_(count) {
        check(pbs_alloc(run, &data_, count, sizeof(T), what, err));
    }
    array(array &&o) noexcept { swap(o); }
    array &operator=(array &&o) noexcept {
        swap(o);
        return *this;
    }
    ~array() { pbs_free(run_, data_); }
    T *data() { return data_; }
    const T *data() const { return data_; }
    size_t size() const { return size_; }
    /* The caller frees it. */
    T *release() { return std::exchange(data_, nullptr); }
    T &operator[](size_t i) { return data_[i]; }

  private:
    void swap(array &o) noexcept {
        std::swap(run_, o.run_);
        std::swap(data_, o.data_);
        std::swap(size_, o.size_);
    }
    pbs_run *run_ = nullptr;
    T *data_ = nullptr;
    size_t size_ = 0;
};

/* Memory that a library takes, counted while this lives. */
class counted {
  public:
    counted(pbs_run *run, size_t bytes, const char *what, pbs_err *err) : run_(run), bytes_(bytes) {
        check(pbs_mem_take(run, bytes, what, err));
    }
    counted(const counted &) = delete;
    counted &operator=(const counted &) = delete;
    ~counted() { pbs_mem_give(run_, bytes_); }

  private:
    pbs_run *run_;
    size_t bytes_;
};

} // namespace pbs
#endif
