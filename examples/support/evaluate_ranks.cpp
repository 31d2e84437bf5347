#include "support/evaluate_ranks.hpp"

#include <cstdlib>

#ifdef CLOTHCTL_EXAMPLE_MPI
#include <mpi.h>
#endif

namespace program {

#ifdef CLOTHCTL_EXAMPLE_MPI

namespace {

/// Whether a launcher started this process. Without one MPI_Init starts helpers, for nothing.
bool launched() {
  for (const char* name : {"OMPI_COMM_WORLD_SIZE", "PMIX_RANK", "PMI_RANK"}) {
    if (std::getenv(name) != nullptr) return true;
  }
  return false;
}

}  // namespace

Ranks::Ranks(int* argc, char*** argv) {
  if (!launched()) return;
  MPI_Init(argc, argv);
  MPI_Comm_rank(MPI_COMM_WORLD, &rank_);
  MPI_Comm_size(MPI_COMM_WORLD, &count_);
}

Ranks::~Ranks() {
  int open = 0;
  MPI_Initialized(&open);
  if (open != 0) MPI_Finalize();
}

void Ranks::share(std::vector<int>& list) const {
  if (count_ == 1) return;
  int size = static_cast<int>(list.size());
  MPI_Bcast(&size, 1, MPI_INT, 0, MPI_COMM_WORLD);
  list.resize(static_cast<std::size_t>(size));
  MPI_Bcast(list.data(), size, MPI_INT, 0, MPI_COMM_WORLD);
}

void Ranks::wait() const {
  if (count_ > 1) MPI_Barrier(MPI_COMM_WORLD);
}

#else

Ranks::Ranks(int*, char***) {}
Ranks::~Ranks() = default;
void Ranks::share(std::vector<int>&) const {}
void Ranks::wait() const {}

#endif

void Ranks::first_alone(const std::function<void()>& work) const {
  if (!first()) wait();
  work();
  if (first()) wait();
}

}  // namespace program
