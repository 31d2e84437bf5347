#pragma once

// The peers of a comparison, each in a module of its own.

#include <dlfcn.h>

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "command_line.hpp"

namespace versus {

/// Returns our entry and those of the modules (paths with ':' between them); of these only the
/// `chosen` ones if there are any. Each module keeps its symbols and those of its libraries
/// private, since they may be compiled in different ways. Calls `refuse(message)` when a module
/// does not open, or when a chosen name, given by `option`, is not built in.
template <class Entry, class Refuse>
std::vector<Entry> open_modules(Entry ours, const std::string& modules, const Names& chosen,
                                const std::string& option, Refuse refuse) {
  std::vector<Entry> all{std::move(ours)};
  for (const std::string& path : CLI::detail::split(modules, ':')) {
    if (path.empty()) continue;
    void* const module = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
    if (module == nullptr) refuse(dlerror());
    void* const function = dlsym(module, "versus_entry");
    if (function == nullptr) refuse(dlerror());
    Entry entry;
    reinterpret_cast<void (*)(Entry*)>(function)(&entry);
    if (chosen.empty() || holds(chosen, entry.name)) all.push_back(entry);
  }
  for (const std::string& name : chosen) {
    if (std::none_of(all.begin(), all.end(), [&](const Entry& e) { return e.name == name; }))
      refuse(option + ": '" + name + "' is not built in");
  }
  return all;
}

}  // namespace versus
