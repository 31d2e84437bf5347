// The entry point of every test executable. Catch2 v3 brings its own in Catch2::Catch2WithMain;
// this file is for v2.

#define CATCH_CONFIG_MAIN
#include <catch2/catch.hpp>
