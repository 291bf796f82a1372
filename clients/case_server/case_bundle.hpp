// What a display needs of a case folder, as files that can be sent: voxels, meshes, and the manifest (docs/gateway.md).
// Nothing of it names the patient. Blocks for seconds; safe from any thread.
#pragma once

#include <filesystem>

#include "base/result.hpp"
#include "clients/casefiles/case_sender.hpp"

namespace bregma::case_server {

// tissue_elements: as deformation.elements of the daemon; 0: without the mesh of the tissue, which a case whose
// brain cannot be meshed has not either. Every other problem is an error that names the file.
[[nodiscard]] base::Result<casefiles::Bundle> bundle_of(const std::filesystem::path &folder, int tissue_elements);

} // namespace bregma::case_server
