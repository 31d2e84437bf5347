// The main function of every test executable under Catch2 v2. With v3 the library
// Catch2::Catch2WithMain provides it.

#define CATCH_CONFIG_MAIN
#include <catch2/catch.hpp>
