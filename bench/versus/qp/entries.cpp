#include "solver.hpp"

namespace versus {

std::vector<Entry> all_entries() {
  std::vector<Entry> all{clothctl_entry()};
#ifdef VERSUS_DAQP_VERSION
  all.push_back(daqp_entry());
#endif
#ifdef VERSUS_PIQP_VERSION
  all.push_back(piqp_entry());
#endif
#ifdef VERSUS_QPOASES_VERSION
  all.push_back(qpoases_entry());
#endif
#ifdef VERSUS_OSQP_VERSION
  all.push_back(osqp_entry());
#endif
#ifdef VERSUS_PROXQP_VERSION
  all.push_back(proxqp_entry());
#endif
#ifdef VERSUS_QPMAD_VERSION
  all.push_back(qpmad_entry());
#endif
#ifdef VERSUS_EIQUADPROG_VERSION
  all.push_back(eiquadprog_entry());
#endif
  return all;
}

}  // namespace versus
