#pragma once

// Reads the text format of the shared quadratic programs into dense matrices. Each section starts
// with a keyword; the file ends with `end`.

#include <cstdlib>
#include <fstream>
#include <string>
#include <vector>

#include "clothctl/core/types.hpp"

namespace clothctl_test {

/// The parts of a problem that change from frame to frame of a sequence.
struct QptFrame {
  Eigen::VectorXd g, rl, ru, lb, ub;
  std::string status;
  double objective = 0;
};

/// One problem, its expected outcome and the frames that may follow it.
struct Qpt {
  std::string name, status;
  Eigen::Index n = 0, m = 0;
  long shift = 0;
  double r = 0, objective = 0;
  Eigen::MatrixXd H, A;
  Eigen::VectorXd g, rl, ru, lb, ub, x, y, z, ray, farkas_y, farkas_z;
  std::vector<QptFrame> frames;
};

/// Reads `path`. Returns false if the file is missing, incomplete or has an unknown section.
inline bool read_qpt(const std::string& path, Qpt& q) {
  std::ifstream in(path);
  if (!in) return false;
  const auto number = [&in] {
    std::string token;
    in >> token;
    return std::strtod(token.c_str(), nullptr);
  };
  const auto count = [&in] {
    Eigen::Index k = 0;
    in >> k;
    return k;
  };
  const auto list = [&](Eigen::VectorXd& v) {
    v.resize(count());
    for (Eigen::Index i = 0; i < v.size(); ++i) v[i] = number();
  };
  const auto bounds = [&](Eigen::VectorXd& lo, Eigen::VectorXd& hi) {
    const Eigen::Index k = count();
    lo.resize(k);
    hi.resize(k);
    for (Eigen::Index i = 0; i < k; ++i) {
      lo[i] = number();
      hi[i] = number();
    }
  };
  QptFrame* frame = nullptr;
  std::string key;
  while (in >> key) {
    if (key == "qpt") {
      if (count() != 1) return false;
    } else if (key == "name") {
      in >> q.name;
    } else if (key == "n") {
      q.n = count();
      q.H.setZero(q.n, q.n);
      q.g.setZero(q.n);
    } else if (key == "m") {
      q.m = count();
      q.A.setZero(q.m, q.n);
    } else if (key == "r") {
      q.r = number();
    } else if (key == "H") {
      for (Eigen::Index k = count(); k > 0; --k) {
        const Eigen::Index i = count();
        const Eigen::Index j = count();
        q.H(i, j) = q.H(j, i) = number();
      }
    } else if (key == "Hdense") {
      count();
      for (Eigen::Index i = 0; i < q.n; ++i) {
        for (Eigen::Index j = 0; j <= i; ++j) q.H(i, j) = q.H(j, i) = number();
      }
    } else if (key == "g") {
      Eigen::VectorXd& g = frame ? frame->g : q.g;
      g.setZero(q.n);
      for (Eigen::Index k = count(); k > 0; --k) {
        const Eigen::Index i = count();
        g[i] = number();
      }
    } else if (key == "A") {
      for (Eigen::Index k = count(); k > 0; --k) {
        const Eigen::Index i = count();
        const Eigen::Index j = count();
        q.A(i, j) = number();
      }
    } else if (key == "rows") {
      bounds(frame ? frame->rl : q.rl, frame ? frame->ru : q.ru);
    } else if (key == "cols") {
      bounds(frame ? frame->lb : q.lb, frame ? frame->ub : q.ub);
    } else if (key == "status") {
      in >> (frame ? frame->status : q.status);
    } else if (key == "objective") {
      (frame ? frame->objective : q.objective) = number();
    } else if (key == "unique") {
      count();
    } else if (key == "shift") {
      q.shift = count();
    } else if (key == "x") {
      list(q.x);
    } else if (key == "y") {
      list(q.y);
    } else if (key == "z") {
      list(q.z);
    } else if (key == "ray") {
      list(q.ray);
    } else if (key == "farkas_y") {
      list(q.farkas_y);
    } else if (key == "farkas_z") {
      list(q.farkas_z);
    } else if (key == "frames") {
      q.frames.reserve(static_cast<std::size_t>(count()));
    } else if (key == "frame") {
      count();
      q.frames.push_back({q.g, q.rl, q.ru, q.lb, q.ub, q.status, 0.0});
      frame = &q.frames.back();
    } else if (key == "end") {
      return true;
    } else {
      return false;
    }
  }
  return false;
}

}  // namespace clothctl_test
