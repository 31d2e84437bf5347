#pragma once

// What a module of a comparison exports; modules.hpp opens it.

/// The function that a module exports. The arguments are the name, the version, and the variants.
#define VERSUS_MODULE(name, version, ...)                                                     \
  extern "C" __attribute__((visibility("default"))) void versus_entry(versus::Entry* entry) { \
    *entry = versus::Entry{name, version, __VA_ARGS__};                                       \
  }
