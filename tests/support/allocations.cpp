#include "support/allocations.hpp"

#include <atomic>
#include <cerrno>
#include <cstddef>
#include <cstdlib>
#include <new>

#if defined(__has_feature)
#if __has_feature(address_sanitizer)
#define CLOTHCTL_TEST_ADDRESS_SANITIZER 1
#elif __has_feature(thread_sanitizer) || __has_feature(memory_sanitizer)
#define CLOTHCTL_TEST_OTHER_SANITIZER 1
#endif
#endif
#if defined(__SANITIZE_ADDRESS__)
#define CLOTHCTL_TEST_ADDRESS_SANITIZER 1
#elif defined(__SANITIZE_THREAD__)
#define CLOTHCTL_TEST_OTHER_SANITIZER 1
#endif

#if defined(CLOTHCTL_TEST_ADDRESS_SANITIZER)
// The address sanitizer has its own allocator, which calls hooks. (The header that declares them is
// missing from g++.)
extern "C" int __sanitizer_install_malloc_and_free_hooks(void (*malloc_hook)(const volatile void*,
                                                                             std::size_t),
                                                         void (*free_hook)(const volatile void*));
#define CLOTHCTL_TEST_COUNTS 1
#elif defined(__GLIBC__) && !defined(CLOTHCTL_TEST_OTHER_SANITIZER)
// glibc exports its allocator under a second name. A program that defines malloc itself therefore
// replaces it for every library that it links.
#define CLOTHCTL_TEST_COUNTS 1
#define CLOTHCTL_TEST_REPLACES_MALLOC 1
#endif

namespace {

// Constant-initialised, so that it can count before any constructor has run.
std::atomic<long> count{0};

}  // namespace

#ifdef CLOTHCTL_TEST_ADDRESS_SANITIZER

namespace {

void count_allocation(const volatile void*, std::size_t) {
  count.fetch_add(1, std::memory_order_relaxed);
}
void ignore_release(const volatile void*) {}

// Not zero if the sanitizer accepted the hooks.
const int installed = __sanitizer_install_malloc_and_free_hooks(count_allocation, ignore_release);

}  // namespace

#endif

#ifdef CLOTHCTL_TEST_REPLACES_MALLOC

extern "C" {

void* __libc_malloc(std::size_t size);
void* __libc_calloc(std::size_t items, std::size_t size);
void* __libc_realloc(void* block, std::size_t size);
void* __libc_memalign(std::size_t alignment, std::size_t size);

void* malloc(std::size_t size) noexcept {
  count.fetch_add(1, std::memory_order_relaxed);
  return __libc_malloc(size);
}

void* calloc(std::size_t items, std::size_t size) noexcept {
  count.fetch_add(1, std::memory_order_relaxed);
  return __libc_calloc(items, size);
}

void* realloc(void* block, std::size_t size) noexcept {
  count.fetch_add(1, std::memory_order_relaxed);
  return __libc_realloc(block, size);
}

void* memalign(std::size_t alignment, std::size_t size) noexcept {
  count.fetch_add(1, std::memory_order_relaxed);
  return __libc_memalign(alignment, size);
}

void* aligned_alloc(std::size_t alignment, std::size_t size) noexcept {
  count.fetch_add(1, std::memory_order_relaxed);
  return __libc_memalign(alignment, size);
}

int posix_memalign(void** block, std::size_t alignment, std::size_t size) noexcept {
  const bool power_of_two = alignment != 0 && (alignment & (alignment - 1)) == 0;
  if (!power_of_two || alignment % sizeof(void*) != 0) return EINVAL;
  count.fetch_add(1, std::memory_order_relaxed);
  void* memory = __libc_memalign(alignment, size);
  if (memory == nullptr) return ENOMEM;
  *block = memory;
  return 0;
}

}  // extern "C"

#endif

namespace clothctl_test {

long allocations() { return count.load(std::memory_order_relaxed); }

bool allocation_counting_works() {
#ifdef CLOTHCTL_TEST_COUNTS
  // Without volatile pointers, the compiler may remove an allocation together with its release.
  const auto seen = [](auto&& allocate, auto&& release) {
    const long before = allocations();
    void* volatile block = allocate();
    const bool counted = allocations() == before + 1 && block != nullptr;
    release(block);
    return counted;
  };
  const auto by_free = [](void* block) { std::free(block); };
  struct alignas(64) Wide {
    double value[8];
  };
  bool all = seen([] { return std::malloc(24); }, by_free);
#ifdef CLOTHCTL_TEST_ADDRESS_SANITIZER
  all = installed != 0 && all;
#endif
  all = seen([] { return std::calloc(3, 8); }, by_free) && all;
  void* volatile none = nullptr;  // with a plain null pointer the compiler may call malloc instead
  all = seen([&none] { return std::realloc(none, 24); }, by_free) && all;
  all = seen([] { return std::aligned_alloc(32, 64); }, by_free) && all;
  all = seen(
            []() -> void* {
              void* block = nullptr;
              return posix_memalign(&block, 32, 64) == 0 ? block : nullptr;
            },
            by_free) &&
        all;
  all = seen([]() -> void* { return ::operator new(24); },
             [](void* block) { ::operator delete(block); }) &&
        all;
  all = seen([]() -> void* { return ::operator new[](24); },
             [](void* block) { ::operator delete[](block); }) &&
        all;
  all = seen([]() -> void* { return new Wide; },
             [](void* block) { delete static_cast<Wide*>(block); }) &&
        all;
  return all;
#else
  return false;
#endif
}

}  // namespace clothctl_test
