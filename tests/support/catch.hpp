#pragma once

// Includes Catch2, version 2 or 3. Version 3 has several headers and keeps Approx in its namespace.
// Version 2 has one header, which puts Approx into the global namespace.

#if __has_include(<catch2/catch_all.hpp>)
#include <catch2/catch_all.hpp>
using Catch::Approx;
#else
#include <catch2/catch.hpp>
#endif
