// `bregma tissue`: the tissue model without a daemon.
#include <memory>
#include <string>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "algorithms/tissue/material/material.hpp"
#include "clients/cli/commands.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/tissue/insert_command.hpp"
#include "clients/cli/tissue/shift_command.hpp"

namespace bregma::cli {
namespace {

std::string law_text(const tissue::Material &material) {
  switch (material.law) {
  case tissue::Law::kNeoHookean:
    return "neo-Hookean";
  case tissue::Law::kOgden:
    return "Ogden, alpha " + fixed(material.ogden_alpha, 1);
  case tissue::Law::kLinear:
    break;
  }
  return "Hooke";
}

nlohmann::json material_json(const tissue::Material &material) {
  nlohmann::json prony = nlohmann::json::array();
  for (const tissue::PronyTerm &term : material.prony) {
    prony.push_back({{"share", term.fraction}, {"time_s", term.time_s}});
  }
  const bool ogden = material.law == tissue::Law::kOgden;
  return {{"name", material.name},
          {"law", law_text(material)},
          {"young_Pa", material.young_Pa},
          {"poisson", material.poisson},
          {"density_kg_m3", material.density_kg_m3},
          {"ogden_alpha", ogden ? nlohmann::json(material.ogden_alpha) : nlohmann::json(nullptr)},
          {"bulk_Pa", material.bulk_Pa()},
          {"shear_Pa", material.shear_Pa()},
          {"relaxed_shear_Pa", material.relaxed_fraction() * material.shear_Pa()},
          {"prony", std::move(prony)},
          {"source", material.source}};
}

int run_materials(const Context &context) {
  if (context.json) {
    nlohmann::json materials = nlohmann::json::array();
    for (const tissue::Material &material : tissue::named_materials()) {
      materials.push_back(material_json(material));
    }
    print_json({{"materials", std::move(materials)}});
    return kOk;
  }
  Table table({"material", "law", "E Pa", "nu", "kg/m^3", "bulk Pa", "shear Pa", "relaxed Pa"});
  std::string sources;
  for (const tissue::Material &material : tissue::named_materials()) {
    table.row({material.name, law_text(material), fixed(material.young_Pa, 0), fixed(material.poisson, 3),
               fixed(material.density_kg_m3, 0), fixed(material.bulk_Pa(), 0), fixed(material.shear_Pa(), 0),
               fixed(material.relaxed_fraction() * material.shear_Pa(), 0)});
    sources += material.name + ": " + material.source + "\n";
  }
  print(table.text() + "\n" + sources +
        "\nBulk and shear follow from E and nu. The thesis prints 1.24e8 Pa and 6.20e6 Pa besides E and nu, which "
        "contradicts them.\nRelaxed: the shear modulus after all relaxation.\n");
  return kOk;
}

} // namespace

void add_tissue_command(CLI::App &app, Context &context) {
  auto *group =
      app.add_subcommand("tissue", "The brain as a deformable body: materials, a probe's insertion, brain shift");
  group->require_subcommand(1);
  auto *materials = group->add_subcommand("materials", "Lists the named materials with their sources");
  add_json_flag(*materials, context);
  materials->footer("Example:\n  bregma tissue materials");
  materials->callback([&context] { context.run = [&context] { return run_materials(context); }; });
  add_insert_command(*group, context);
  add_shift_command(*group, context);
}

} // namespace bregma::cli
