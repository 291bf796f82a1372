#include "casefile/volumes/label_names.hpp"

#include <algorithm>
#include <array>
#include <utility>

#include "base/read_file.hpp"
#include "base/text.hpp"

namespace bregma::casefile {
namespace {

namespace fs = std::filesystem;

std::vector<std::string_view> words_of(std::string_view text) {
  std::vector<std::string_view> out;
  for (std::size_t at = text.find_first_not_of(" \t"); at < text.size(); at = text.find_first_not_of(" \t", at)) {
    const std::size_t end = std::min(text.find_first_of(" \t", at), text.size());
    out.push_back(text.substr(at, end - at));
    at = end;
  }
  return out;
}

bool is_number(std::string_view text) { return base::parsed_number<double>(text).has_value(); }

std::string_view unquoted(std::string_view cell) {
  return cell.size() > 1 && cell.front() == '"' && cell.back() == '"' ? cell.substr(1, cell.size() - 2) : cell;
}

// The name of a line whose first word or cell is the number; empty if there is none.
std::string name_in(std::string_view line) {
  const std::string_view numbers = line.substr(0, line.find_first_not_of("0123456789. \t"));
  const bool quoted = line.substr(numbers.size()).starts_with('"'); // ITK-SNAP: the name may contain every separator
  const char separator = quoted                                      ? ' '
                         : line.find('\t') != std::string_view::npos ? '\t'
                         : line.find(';') != std::string_view::npos  ? ';'
                         : line.find(',') != std::string_view::npos  ? ','
                                                                     : ' ';
  if (separator != ' ') {
    const auto cells = base::cells(line, separator);
    for (const std::size_t at : {2U, 1U}) { // a third cell in words is the long form of the second
      if (at < cells.size() && !cells[at].empty() && !is_number(cells[at])) {
        return std::string(unquoted(cells[at]));
      }
    }
    return "";
  }
  if (const std::size_t quote = line.find('"'); quote != std::string_view::npos) {
    const std::size_t end = line.find('"', quote + 1);
    return end == std::string_view::npos ? "" : std::string(line.substr(quote + 1, end - quote - 1));
  }
  std::string out;
  const auto words = words_of(line);
  for (std::size_t at = 1; at < words.size() && !is_number(words[at]); ++at) {
    out += (out.empty() ? "" : " ") + std::string(words[at]);
  }
  return out;
}

std::optional<int> number_in(std::string_view line) {
  const std::size_t end = line.find_first_of(" \t;,");
  return base::parsed_number<int>(unquoted(line.substr(0, end)));
}

class Reading {
public:
  explicit Reading(fs::path file) : file_(std::move(file)) {}

  base::Result<void> add(int line, int number, std::string name) {
    if (!out_.emplace(number, std::move(name)).second) {
      return refuse(line, "region " + std::to_string(number) + " is named a second time");
    }
    return {};
  }
  [[nodiscard]] base::Result<void> refuse(int line, const std::string &what) const {
    return base::failure(file_.string() + ": line " + std::to_string(line) + ": " + what);
  }

  base::Result<LabelNames> lines(std::string_view all) {
    for (int line = 1; !all.empty(); ++line) {
      const std::size_t end = std::min(all.find('\n'), all.size());
      const std::string_view text = base::trimmed(all.substr(0, end));
      all.remove_prefix(std::min(end + 1, all.size()));
      if (text.empty() || text.front() == '#') {
        continue;
      }
      const auto number = number_in(text);
      if (!number && out_.empty() && line == 1 && text.find_first_of(";,\t") != std::string_view::npos) {
        continue; // the header of a table
      }
      const std::string name = number ? name_in(text) : "";
      const auto added =
          name.empty() ? refuse(line, "\"" + std::string(text.substr(0, 60)) + "\" is not a region number and a name")
                       : add(line, *number, name);
      if (!added) {
        return tl::unexpected(added.error());
      }
    }
    return out_;
  }

  // <label><index>31</index>...<name>Right Amygdala</name></label>
  base::Result<LabelNames> xml(std::string_view all) {
    int line = 1;
    while (const auto index = element(all, "index", line)) {
      const auto name = element(all, "name", line);
      const auto number = base::parsed_number<int>(base::trimmed(*index));
      const auto added = !number || !name
                             ? refuse(line, "<index>" + std::string(index->substr(0, 60)) + "</index> has no name")
                             : add(line, *number, std::string(base::trimmed(*name)));
      if (!added) {
        return tl::unexpected(added.error());
      }
    }
    return out_.empty() ? base::Result<LabelNames>(base::failure(file_.string() + ": holds no <index> and <name>"))
                        : out_;
  }

private:
  // The text of the next element of the name; what is before it is removed.
  static std::optional<std::string_view> element(std::string_view &all, const std::string &name, int &line) {
    const std::string open = "<" + name + ">";
    const std::size_t begin = all.find(open);
    const std::size_t end = begin == std::string_view::npos ? begin : all.find("</" + name + ">", begin);
    if (end == std::string_view::npos) {
      return std::nullopt;
    }
    line += static_cast<int>(std::count(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(end), '\n'));
    const std::string_view out = all.substr(begin + open.size(), end - begin - open.size());
    all.remove_prefix(end);
    return out;
  }

  fs::path file_;
  LabelNames out_;
};

// Numbered from 1.
constexpr std::string_view kHammers =
    "Hippocampus_r Hippocampus_l Amygdala_r Amygdala_l Ant_TL_med_r Ant_TL_med_l Ant_TL_inf_lat_r Ant_TL_inf_lat_l "
    "G_paraH_amb_r G_paraH_amb_l G_sup_temp_cent_r G_sup_temp_cent_l G_tem_midin_r G_tem_midin_l G_occtem_la_r "
    "G_occtem_la_l Cerebellum_r Cerebellum_l Brainstem Insula_l Insula_r OL_rest_lat_l OL_rest_lat_r G_cing_ant_sup_l "
    "G_cing_ant_sup_r G_cing_post_l G_cing_post_r FL_mid_fr_G_l FL_mid_fr_G_r PosteriorTL_l PosteriorTL_r PL_rest_l "
    "PL_rest_r CaudateNucl_l CaudateNucl_r NuclAccumb_l NuclAccumb_r Putamen_l Putamen_r Thalamus_l Thalamus_r "
    "Pallidum_l Pallidum_r Corp_Callosum FrontalHorn_r FrontalHorn_l TemporaHorn_r TemporaHorn_l ThirdVentricl "
    "FL_precen_G_l FL_precen_G_r FL_strai_G_l FL_strai_G_r FL_OFC_AOG_l FL_OFC_AOG_r FL_inf_fr_G_l FL_inf_fr_G_r "
    "FL_sup_fr_G_l FL_sup_fr_G_r PL_postce_G_l PL_postce_G_r PL_sup_pa_G_l PL_sup_pa_G_r OL_ling_G_l OL_ling_G_r "
    "OL_cuneus_l OL_cuneus_r FL_OFC_MOG_l FL_OFC_MOG_r FL_OFC_LOG_l FL_OFC_LOG_r FL_OFC_POG_l FL_OFC_POG_r S_nigra_l "
    "S_nigra_r Subgen_antCing_l Subgen_antCing_r Subcall_area_l Subcall_area_r Presubgen_antCing_l Presubgen_antCing_r "
    "G_sup_temp_ant_l G_sup_temp_ant_r";

using NumberedName = std::pair<int, std::string_view>;

// Of the left side; the right one is at the second number.
struct Sided {
  int left, right;
  std::string_view name;
};

constexpr std::array<Sided, 18> kAseg{{{2, 41, "Cerebral-White-Matter"},
                                       {3, 42, "Cerebral-Cortex"},
                                       {4, 43, "Lateral-Ventricle"},
                                       {5, 44, "Inf-Lat-Vent"},
                                       {7, 46, "Cerebellum-White-Matter"},
                                       {8, 47, "Cerebellum-Cortex"},
                                       {10, 49, "Thalamus"},
                                       {11, 50, "Caudate"},
                                       {12, 51, "Putamen"},
                                       {13, 52, "Pallidum"},
                                       {17, 53, "Hippocampus"},
                                       {18, 54, "Amygdala"},
                                       {26, 58, "Accumbens-area"},
                                       {28, 60, "VentralDC"},
                                       {30, 62, "vessel"},
                                       {31, 63, "choroid-plexus"},
                                       {25, 57, "Lesion"},
                                       {78, 79, "WM-hypointensities"}}};
constexpr std::array<NumberedName, 12> kAsegMiddle{{{14, "3rd-Ventricle"},
                                                    {15, "4th-Ventricle"},
                                                    {16, "Brain-Stem"},
                                                    {24, "CSF"},
                                                    {72, "5th-Ventricle"},
                                                    {77, "WM-hypointensities"},
                                                    {85, "Optic-Chiasm"},
                                                    {251, "CC_Posterior"},
                                                    {252, "CC_Mid_Posterior"},
                                                    {253, "CC_Central"},
                                                    {254, "CC_Mid_Anterior"},
                                                    {255, "CC_Anterior"}}};
// Numbered from 1001 (left) and 2001 (right).
constexpr std::string_view kDesikan =
    "bankssts caudalanteriorcingulate caudalmiddlefrontal corpuscallosum cuneus entorhinal fusiform inferiorparietal "
    "inferiortemporal isthmuscingulate lateraloccipital lateralorbitofrontal lingual medialorbitofrontal "
    "middletemporal "
    "parahippocampal paracentral parsopercularis parsorbitalis parstriangularis pericalcarine postcentral "
    "posteriorcingulate precentral precuneus rostralanteriorcingulate rostralmiddlefrontal superiorfrontal "
    "superiorparietal superiortemporal supramarginal frontalpole temporalpole transversetemporal insula";

constexpr std::array<NumberedName, 7> kNeuroMiddle{{{4, "3rd Ventricle"},
                                                    {11, "4th Ventricle"},
                                                    {35, "Brain Stem"},
                                                    {46, "CSF"},
                                                    {71, "Cerebellar Vermal Lobules I-V"},
                                                    {72, "Cerebellar Vermal Lobules VI-VII"},
                                                    {73, "Cerebellar Vermal Lobules VIII-X"}}};
constexpr std::array<Sided, 15> kNeuroDeep{{{30, 23, "Accumbens Area"},
                                            {32, 31, "Amygdala"},
                                            {37, 36, "Caudate"},
                                            {39, 38, "Cerebellum Exterior"},
                                            {41, 40, "Cerebellum White Matter"},
                                            {45, 44, "Cerebral White Matter"},
                                            {48, 47, "Hippocampus"},
                                            {50, 49, "Inf Lat Vent"},
                                            {52, 51, "Lateral Ventricle"},
                                            {56, 55, "Pallidum"},
                                            {58, 57, "Putamen"},
                                            {60, 59, "Thalamus Proper"},
                                            {62, 61, "Ventral DC"},
                                            {75, 76, "Basal Forebrain"},
                                            {101, 100, "ACgG anterior cingulate gyrus"}}};
// The right side has the even number, the left one the next.
constexpr std::array<NumberedName, 48> kNeuroCortex{{{102, "AIns anterior insula"},
                                                     {104, "AOrG anterior orbital gyrus"},
                                                     {106, "AnG angular gyrus"},
                                                     {108, "Calc calcarine cortex"},
                                                     {112, "CO central operculum"},
                                                     {114, "Cun cuneus"},
                                                     {116, "Ent entorhinal area"},
                                                     {118, "FO frontal operculum"},
                                                     {120, "FRP frontal pole"},
                                                     {122, "FuG fusiform gyrus"},
                                                     {124, "GRe gyrus rectus"},
                                                     {128, "IOG inferior occipital gyrus"},
                                                     {132, "ITG inferior temporal gyrus"},
                                                     {134, "LiG lingual gyrus"},
                                                     {136, "LOrG lateral orbital gyrus"},
                                                     {138, "MCgG middle cingulate gyrus"},
                                                     {140, "MFC medial frontal cortex"},
                                                     {142, "MFG middle frontal gyrus"},
                                                     {144, "MOG middle occipital gyrus"},
                                                     {146, "MOrG medial orbital gyrus"},
                                                     {148, "MPoG postcentral gyrus medial segment"},
                                                     {150, "MPrG precentral gyrus medial segment"},
                                                     {152, "MSFG superior frontal gyrus medial segment"},
                                                     {154, "MTG middle temporal gyrus"},
                                                     {156, "OCP occipital pole"},
                                                     {160, "OFuG occipital fusiform gyrus"},
                                                     {162, "OpIFG opercular part of the inferior frontal gyrus"},
                                                     {164, "OrIFG orbital part of the inferior frontal gyrus"},
                                                     {166, "PCgG posterior cingulate gyrus"},
                                                     {168, "PCu precuneus"},
                                                     {170, "PHG parahippocampal gyrus"},
                                                     {172, "PIns posterior insula"},
                                                     {174, "PO parietal operculum"},
                                                     {176, "PoG postcentral gyrus"},
                                                     {178, "POrG posterior orbital gyrus"},
                                                     {180, "PP planum polare"},
                                                     {182, "PrG precentral gyrus"},
                                                     {184, "PT planum temporale"},
                                                     {186, "SCA subcallosal area"},
                                                     {190, "SFG superior frontal gyrus"},
                                                     {192, "SMC supplementary motor cortex"},
                                                     {194, "SMG supramarginal gyrus"},
                                                     {196, "SOG superior occipital gyrus"},
                                                     {198, "SPL superior parietal lobule"},
                                                     {200, "STG superior temporal gyrus"},
                                                     {202, "TMP temporal pole"},
                                                     {204, "TrIFG triangular part of the inferior frontal gyrus"},
                                                     {206, "TTG transverse temporal gyrus"}}};

void number_words(std::string_view words, int first, const std::string &before, LabelNames &out) {
  for (const std::string_view word : words_of(words)) {
    out[first++] = before + std::string(word);
  }
}

LabelNames hammers() {
  LabelNames out;
  number_words(kHammers, 1, "", out);
  return out;
}

LabelNames freesurfer() {
  LabelNames out(kAsegMiddle.begin(), kAsegMiddle.end());
  for (const Sided &region : kAseg) {
    out[region.left] = "Left-" + std::string(region.name);
    out[region.right] = "Right-" + std::string(region.name);
  }
  number_words(kDesikan, 1001, "ctx-lh-", out);
  number_words(kDesikan, 2001, "ctx-rh-", out);
  return out;
}

LabelNames neuromorphometrics() {
  LabelNames out(kNeuroMiddle.begin(), kNeuroMiddle.end());
  for (const Sided &region : kNeuroDeep) {
    out[region.left] = "Left " + std::string(region.name);
    out[region.right] = "Right " + std::string(region.name);
  }
  for (const auto &[right, name] : kNeuroCortex) {
    out[right] = "Right " + std::string(name);
    out[right + 1] = "Left " + std::string(name);
  }
  return out;
}

} // namespace

base::Result<LabelNames> read_label_names(const fs::path &file) {
  constexpr std::size_t kMaxBytes = std::size_t{4} << 20;
  const auto all = base::read_file(file, kMaxBytes);
  if (!all) {
    return tl::unexpected(all.error());
  }
  std::string_view text = *all;
  if (text.starts_with("\xEF\xBB\xBF")) {
    text.remove_prefix(3);
  }
  const std::size_t first = text.find_first_not_of(" \t\r\n");
  return first != std::string_view::npos && text[first] == '<' ? Reading(file).xml(text) : Reading(file).lines(text);
}

std::optional<LabelNames> known_label_names(std::string_view atlas) {
  const std::string name = base::lower(atlas);
  return name == "freesurfer"           ? std::optional(freesurfer())
         : name == "hammers"            ? std::optional(hammers())
         : name == "neuromorphometrics" ? std::optional(neuromorphometrics())
                                        : std::nullopt;
}

std::optional<Side> side_named(std::string_view name) {
  const std::string text = base::lower(name);
  const auto says = [&text](std::string_view word, const std::string &letter) {
    return text.ends_with("_" + letter) || text.ends_with(" " + letter) || text.ends_with("." + letter) ||
           text.find("-" + letter + "h-") != std::string::npos || text.starts_with(letter + "h_") ||
           text.find(word) != std::string::npos;
  };
  const bool left = says("left", "l");
  const bool right = says("right", "r");
  return left == right ? std::nullopt : std::optional(left ? Side::kLeft : Side::kRight);
}

std::vector<std::string> known_atlases() { return {"freesurfer", "hammers", "neuromorphometrics"}; }

} // namespace bregma::casefile
