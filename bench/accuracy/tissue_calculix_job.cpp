#include "bench/accuracy/tissue_calculix_job.hpp"

#include <array>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iomanip>
#include <map>
#include <sstream>
#include <stdexcept>

namespace bregma::bench {
namespace {

constexpr double kMetre = 1000.0; // mm

struct Job {
  std::vector<Eigen::Vector3d> nodes_mm;
  std::vector<std::vector<int>> elements;
  std::vector<int> held, pushed;
};

Job job_of(const Indentation &problem, CalculixElement element) {
  Job job{problem.mesh.nodes_mm, {}, problem.held, problem.pushed};
  std::vector<char> is_held(job.nodes_mm.size()), is_pushed(job.nodes_mm.size());
  for (const int node : job.held) {
    is_held[static_cast<std::size_t>(node)] = 1;
  }
  for (const int node : job.pushed) {
    is_pushed[static_cast<std::size_t>(node)] = 1;
  }
  // Order of the mid-edge nodes in CalculiX.
  constexpr std::array<std::array<int, 2>, 6> kEdges{{{0, 1}, {1, 2}, {0, 2}, {0, 3}, {1, 3}, {2, 3}}};
  std::map<std::pair<int, int>, int> middles;
  for (const Eigen::Vector4i &t : problem.mesh.tetrahedra) {
    std::vector<int> nodes(t.begin(), t.end());
    for (const auto &edge : kEdges) {
      if (element == CalculixElement::kC3D4) {
        break;
      }
      const auto ends = std::minmax(t[edge[0]], t[edge[1]]);
      const auto a = static_cast<std::size_t>(ends.first);
      const auto b = static_cast<std::size_t>(ends.second);
      const auto [at, is_new] = middles.try_emplace(ends, static_cast<int>(job.nodes_mm.size()));
      if (is_new) {
        job.nodes_mm.emplace_back(0.5 * (job.nodes_mm[a] + job.nodes_mm[b]));
        if (is_held[a] != 0 && is_held[b] != 0) {
          job.held.push_back(at->second);
        }
        if (is_pushed[a] != 0 && is_pushed[b] != 0) {
          job.pushed.push_back(at->second);
        }
      }
      nodes.push_back(at->second);
    }
    job.elements.push_back(std::move(nodes));
  }
  return job;
}

void write(const Job &job, const Indentation &problem, CalculixElement element, const std::string &file) {
  std::ofstream out(file);
  out << std::setprecision(12) << "*NODE, NSET=NALL\n";
  for (std::size_t i = 0; i < job.nodes_mm.size(); ++i) {
    const Eigen::Vector3d m = job.nodes_mm[i] / kMetre;
    out << i + 1 << ", " << m.x() << ", " << m.y() << ", " << m.z() << '\n';
  }
  out << "*ELEMENT, ELSET=EALL, TYPE=" << (element == CalculixElement::kC3D4 ? "C3D4" : "C3D10") << '\n';
  for (std::size_t e = 0; e < job.elements.size(); ++e) {
    out << e + 1;
    for (const int node : job.elements[e]) {
      out << ", " << node + 1;
    }
    out << '\n';
  }
  const auto set = [&](const char *name, const std::vector<int> &nodes) {
    out << "*NSET, NSET=" << name << '\n';
    for (const int node : nodes) {
      out << node + 1 << ",\n";
    }
  };
  set("HELD", job.held);
  set("PUSHED", job.pushed);
  // C10 = mu / 2, D1 = 2 / kappa: the energy of material.hpp.
  out << "*MATERIAL, NAME=BRAIN\n*HYPERELASTIC, NEO HOOKE\n"
      << 0.5 * problem.material.shear_Pa() << ", " << 2.0 / problem.material.bulk_Pa()
      << "\n*SOLID SECTION, ELSET=EALL, MATERIAL=BRAIN\n*STEP, NLGEOM, INC=1000\n*STATIC\n0.25, 1.\n*BOUNDARY\n"
      << "HELD, 1, 3\n";
  for (const int node : job.pushed) {
    const Eigen::Vector3d prescribed = problem.prescribed_mm(job.nodes_mm[static_cast<std::size_t>(node)]) / kMetre;
    for (int axis = 0; axis < 3; ++axis) {
      out << node + 1 << ", " << axis + 1 << ", " << axis + 1 << ", " << prescribed[axis] << '\n';
    }
  }
  out << "*NODE PRINT, NSET=NALL, FREQUENCY=1000\nU\n*NODE PRINT, NSET=PUSHED, FREQUENCY=1000\nRF\n*END STEP\n";
  if (!out.flush()) {
    throw std::runtime_error("cannot write " + file);
  }
}

// Tables of the last time step in the file.
CalculixAnswer read(const std::string &file, std::size_t nodes) {
  CalculixAnswer out;
  out.displacement_mm.assign(nodes, Eigen::Vector3d::Zero());
  std::ifstream in(file);
  std::string line;
  bool displacements = false;
  bool forces = false;
  std::size_t seen = 0;
  while (std::getline(in, line)) {
    if (line.find("displacements") != std::string::npos) {
      displacements = true;
      forces = false;
    } else if (line.find("forces") != std::string::npos) {
      displacements = false;
      forces = true;
      out.force_N.setZero();
    }
    std::istringstream words(line);
    std::size_t node = 0;
    Eigen::Vector3d v;
    if (!(words >> node >> v.x() >> v.y() >> v.z())) {
      continue;
    }
    if (forces) {
      out.force_N += v;
    } else if (displacements && node >= 1 && node <= nodes) {
      out.displacement_mm[node - 1] = kMetre * v;
      ++seen;
    }
  }
  if (seen < nodes) {
    throw std::runtime_error("CalculiX gave no answer: " + file);
  }
  return out;
}

} // namespace

bool calculix_available() { return std::system("command -v ccx >/dev/null 2>&1") == 0; } // NOLINT(cert-env33-c)

CalculixAnswer run_calculix(const Indentation &problem, CalculixElement element, const std::string &folder) {
  std::filesystem::create_directories(folder);
  const std::string name = element == CalculixElement::kC3D4 ? "c3d4" : "c3d10";
  const std::string path = folder + "/" + name;
  std::filesystem::remove(path + ".dat");
  write(job_of(problem, element), problem, element, path + ".inp");
  const auto begin = std::chrono::steady_clock::now();
  const std::string command = "cd '" + folder + "' && OMP_NUM_THREADS=2 ccx " + name + " >" + name + ".log 2>&1";
  if (std::system(command.c_str()) != 0) { // NOLINT(cert-env33-c)
    throw std::runtime_error("CalculiX failed; see " + path + ".log");
  }
  const double wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  CalculixAnswer out = read(path + ".dat", problem.mesh.nodes_mm.size());
  out.wall_s = wall_s;
  return out;
}

} // namespace bregma::bench
