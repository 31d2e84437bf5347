#pragma once

// Instances of heavy templates that many tests use, besides those of CLOTHCTL_PRECOMPILED. They are
// declared here, in the precompiled header of the tests, and compiled once, in instances.cpp.

#include <Eigen/Dense>

#include <clothctl/cloth.hpp>
#include <clothctl/mpc.hpp>
#include <clothctl/qp.hpp>

#ifndef CLOTHCTL_TEST_EXTERN
#define CLOTHCTL_TEST_EXTERN extern
#endif

CLOTHCTL_TEST_EXTERN template class clothctl::ActiveSet<float>;
CLOTHCTL_TEST_EXTERN template class clothctl::BoxActiveSet<float>;
CLOTHCTL_TEST_EXTERN template class clothctl::MassSpring<float>;
CLOTHCTL_TEST_EXTERN template class clothctl::PositionBased<float>;
CLOTHCTL_TEST_EXTERN template class clothctl::PositionBased<long double>;
CLOTHCTL_TEST_EXTERN template class clothctl::MassSpringResponse<double>;
CLOTHCTL_TEST_EXTERN template class clothctl::LinearisedPredictor<
    clothctl::MassSpringResponse<double>, double>;
// Right-hand sides eight at a time, as the predictors solve them.
CLOTHCTL_TEST_EXTERN template void clothctl::BlockSymmetric<double>::multiply(
    const clothctl::Lanes<double, 8>&, clothctl::Lanes<double, 8>&) const;
CLOTHCTL_TEST_EXTERN template void clothctl::BlockCholesky<double>::solve(
    clothctl::Lanes<double, 8>&);
// Eigen's factors, an independent oracle of many tests.
CLOTHCTL_TEST_EXTERN template class Eigen::LLT<Eigen::MatrixXd>;
CLOTHCTL_TEST_EXTERN template Eigen::LLT<Eigen::MatrixXd>& Eigen::LLT<Eigen::MatrixXd>::compute(
    const Eigen::EigenBase<Eigen::MatrixXd>&);
CLOTHCTL_TEST_EXTERN template class Eigen::JacobiSVD<Eigen::MatrixXd>;
CLOTHCTL_TEST_EXTERN template class Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>;
CLOTHCTL_TEST_EXTERN template Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>&
Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>::compute(const Eigen::EigenBase<Eigen::MatrixXd>&,
                                                        int);
