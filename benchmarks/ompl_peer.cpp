// OMPL's planners over Reeds-Shepp curves on the questions of planning_problems.py, which compiles and calls this.
//
//     ompl_peer PLANNER SOLVE_S SIMPLIFY_S < questions > answers
//
// PLANNER: RRTConnect, which stops at its first path; BITstar or AITstar, which shorten it until SOLVE_S. Times are
// processor time of its one thread, so other programs disturb little.
//
// A question is a line "rows columns resolution x0 y0 phi, start x y theta, goal x y theta" (metres, radians, without
// the commas), followed by rows x columns doubles: the margin at the middles of the cells, negative where the robot's
// centre must not be. The answer is a line "seconds metres" (of planning and shortening), or "none".

#include <algorithm>
#include <cmath>
#include <ctime>
#include <iostream>
#include <memory>
#include <string>
#include <vector>

#include <ompl/base/objectives/PathLengthOptimizationObjective.h>
#include <ompl/base/spaces/ReedsSheppStateSpace.h>
#include <ompl/geometric/SimpleSetup.h>
#include <ompl/geometric/planners/informedtrees/AITstar.h>
#include <ompl/geometric/planners/informedtrees/BITstar.h>
#include <ompl/geometric/planners/rrt/RRTConnect.h>
#include <ompl/util/Console.h>
#include <ompl/util/RandomNumbers.h>

namespace ob = ompl::base;
namespace og = ompl::geometric;

struct Question {
    int rows, columns;
    double resolution, x0, y0, phi, start[3], goal[3];
    std::vector<double> margin;

    bool read(std::istream &in) {
        in >> rows >> columns >> resolution >> x0 >> y0 >> phi;
        for (double *pose : {start, goal})
            in >> pose[0] >> pose[1] >> pose[2];
        if (!in || in.get() != '\n')
            return false;
        margin.resize(static_cast<size_t>(rows) * columns);
        in.read(reinterpret_cast<char *>(margin.data()), margin.size() * sizeof(double));
        return static_cast<bool>(in);
    }

    // Bilinear, as kernels/occupancy/clearance.py.
    double at(double x, double y) const {
        double u = std::clamp((x - x0) / resolution - 0.5, 0.0, columns - 1.0);
        double w = std::clamp((y - y0) / resolution - 0.5, 0.0, rows - 1.0);
        int j = std::min(static_cast<int>(u), columns - 2), i = std::min(static_cast<int>(w), rows - 2);
        double fu = u - j, fw = w - i;
        const double *low = &margin[static_cast<size_t>(i) * columns + j], *high = low + columns;
        return (low[0] * (1 - fu) + low[1] * fu) * (1 - fw) + (high[0] * (1 - fu) + high[1] * fu) * fw;
    }
};

ob::PlannerPtr planner(const std::string &name, const ob::SpaceInformationPtr &si) {
    if (name == "BITstar")
        return std::make_shared<og::BITstar>(si);
    if (name == "AITstar")
        return std::make_shared<og::AITstar>(si);
    return std::make_shared<og::RRTConnect>(si);
}

int main(int argc, char **argv) {
    if (argc != 4) {
        std::cerr << "usage: ompl_peer RRTConnect|BITstar|AITstar SOLVE_S SIMPLIFY_S\n";
        return 2;
    }
    ompl::msg::setLogLevel(ompl::msg::LOG_NONE);
    ompl::RNG::setSeed(1);
    const double solve_s = std::stod(argv[2]), simplify_s = std::stod(argv[3]);
    Question asked;
    while (asked.read(std::cin)) {
        auto space = std::make_shared<ob::ReedsSheppStateSpace>(1.0 / asked.phi);
        ob::RealVectorBounds bounds(2);
        for (int axis : {0, 1}) {
            double low = axis ? asked.y0 : asked.x0;
            bounds.setLow(axis, low);
            bounds.setHigh(axis, low + (axis ? asked.rows : asked.columns) * asked.resolution);
        }
        space->setBounds(bounds);
        og::SimpleSetup setup(space);
        setup.setStateValidityChecker([&asked](const ob::State *state) {
            auto *pose = state->as<ob::SE2StateSpace::StateType>();
            return asked.at(pose->getX(), pose->getY()) >= 0.0;
        });
        setup.getSpaceInformation()->setStateValidityCheckingResolution(0.003);
        ob::ScopedState<ob::SE2StateSpace> ends[] = {ob::ScopedState<ob::SE2StateSpace>(space),
                                                     ob::ScopedState<ob::SE2StateSpace>(space)};
        for (int k : {0, 1}) {
            const double *pose = k ? asked.goal : asked.start;
            ends[k]->setXY(pose[0], pose[1]);
            ends[k]->setYaw(pose[2]);
        }
        setup.setStartAndGoalStates(ends[0], ends[1]);
        setup.setOptimizationObjective(
            std::make_shared<ob::PathLengthOptimizationObjective>(setup.getSpaceInformation()));
        setup.setPlanner(planner(argv[1], setup.getSpaceInformation()));
        const std::clock_t begun = std::clock();
        auto took_s = [](std::clock_t since) { return static_cast<double>(std::clock() - since) / CLOCKS_PER_SEC; };
        ob::PlannerTerminationCondition until([&] { return took_s(begun) > solve_s; });
        if (!setup.solve(until) || !setup.haveExactSolutionPath()) {
            std::cout << "none" << std::endl;
            continue;
        }
        const std::clock_t solved = std::clock();
        ob::PlannerTerminationCondition enough([&] { return took_s(solved) > simplify_s; });
        if (simplify_s > 0.0)
            setup.simplifySolution(enough);
        std::cout << took_s(begun) << " " << setup.getSolutionPath().length() << std::endl;
    }
}
