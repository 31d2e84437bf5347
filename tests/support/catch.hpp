#pragma once

// Catch2 of either generation under one name. Version 3 splits its header and keeps Approx in its
// namespace; version 2 has one header, which already puts Approx into the global namespace.

#if __has_include(<catch2/catch_all.hpp>)
#include <catch2/catch_all.hpp>
using Catch::Approx;
#else
#include <catch2/catch.hpp>
#endif
