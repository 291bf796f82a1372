// Names of the regions of a label image: from a table beside it, or of an atlas whose numbers are known here.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/result.hpp"

namespace bregma::casefile {

using LabelNames = std::map<int, std::string>;

// A region per line: its number, then its name. In cells between commas, semicolons or tabs the name is the second
// cell, or the third where the second is a short form; between blanks it is the words up to the next number (the tables
// of MRIcron, FreeSurfer's colour table), or the text in quotes (ITK-SNAP). SPM's and CAT12's XML: <index>, <name>.
// Lines that begin with # are comments; a first line without a number is a header.
[[nodiscard]] base::Result<LabelNames> read_label_names(const std::filesystem::path &file);

// "freesurfer": aseg and Desikan-Killiany (FreeSurferColorLUT.txt of FreeSurfer). "hammers": Hammers_mith n30r83
// (Hammers et al. 2003, Gousias et al. 2008). "neuromorphometrics": the atlas of SPM12 and of MICCAI 2012 (not GIF's,
// whose numbers are one higher). Empty: another name.
[[nodiscard]] std::optional<LabelNames> known_label_names(std::string_view atlas);
[[nodiscard]] std::vector<std::string> known_atlases();

// What a name says: "Precentral_L", "left M1", "ctx-lh-precentral"; nothing for a name that says both or neither.
enum class Side { kLeft, kRight };
[[nodiscard]] std::optional<Side> side_named(std::string_view name);

} // namespace bregma::casefile
