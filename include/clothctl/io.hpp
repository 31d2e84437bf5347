#pragma once

// Files: comma-separated tables, targets, players. Not part of the umbrella header.

#include "clothctl/io/base64.hpp"
#include "clothctl/io/csv.hpp"
#include "clothctl/io/file.hpp"
#include "clothctl/io/targets.hpp"
