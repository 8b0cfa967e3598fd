//! The user's guide, page by page.
//!
//! | page | what it answers |
//! |---|---|
//! | [Getting started](getting_started) | How do I install Cumulo, and what does a first reconstruction look like? |
//! | [Five paths](paths) | How do I get from a smoke, a scan, a scene, photographs or a script to what I want? |
//! | [Looking](looking) | How do I see what is in a file, and write a single picture? |
//! | [Captures](captures) | How do I hand over my own pictures, or pictures from Blender? |
//! | [Blender](blender) | How do I get from a Blender scene to a render, a capture, a reconstruction, and back? |
//! | [Transfer functions](transfer_functions) | How do densities become colors, and which file formats are read? |
//! | [Pictures of scans](scans) | How do I show a scan: shaded, under light, from the patient's sides, as a figure? |
//! | [Volumes](volumes) | How do I change axes, names, voxels and forms of VDB grids for another program? |
//! | [Medical and scientific grids](grids) | How do I get scans and simulations into OpenVDB, and grids out of it? |
//! | [Scattering](scattering) | How do I render smoke and clouds that scatter light? |
//! | [USD stages](usd) | How do I render a stage from Blender or Houdini, and what is read of it? |
//! | [Denoising](denoising) | How do I take the noise out of a sequence, from Cumulo or from Blender? |
//! | [Stages](usd_authoring) | How do I write a USD stage of my volumes, and what is wrong with one? |
//! | [Planning](planning) | Which effects of light are simulated, what do they cost, and what may be left out? |
//! | [Reconstruction](reconstruction) | How do I find densities, transfer functions, colors, poses and viewpoints? |
//! | [Gradients](gradients) | Which derivatives are there, and how are they checked? |
//! | [A loss of your own](own_loss) | How do I differentiate a loss that I write in NumPy or PyTorch? |
//! | [PyTorch](torch) | How do I fit densities, functions and cameras to pictures under a loss of my own? |
//! | [Accuracy and cost](accuracy_and_cost) | What does accuracy cost in time and memory? |
//! | [Self-test](self_test) | Which inputs break formulas of rendering, and is the program right on my machine? |
//! | [Scripts](shell) | How do I work on sequences, read exit codes and JSON, and check renders in a pipeline? |
//! | [Farms](farms) | How do I render on several machines, with Open Job Description, Dask, Ray or OpenCue? |
//! | [Python](python) | How do I call it from Python, and test renders with pytest? |
//! | [Library](library) | How do I call all of this from Rust? |
//!
//! Every command on these pages runs in the test `tests/cli/guide.rs`.

#[doc = include_str!("guide/accuracy-and-cost.md")]
pub mod accuracy_and_cost {}

#[doc = include_str!("guide/blender.md")]
pub mod blender {}

#[doc = include_str!("guide/captures.md")]
pub mod captures {}

#[doc = include_str!("guide/denoising.md")]
pub mod denoising {}

#[doc = include_str!("guide/farms.md")]
pub mod farms {}

#[doc = include_str!("guide/getting-started.md")]
pub mod getting_started {}

#[doc = include_str!("guide/gradients.md")]
pub mod gradients {}

#[doc = include_str!("guide/grids.md")]
pub mod grids {}

#[doc = include_str!("guide/library.md")]
///
/// ## Load a volume and render a view
#[doc = concat!("```ignore\n", include_str!("../tests/examples/load_and_render.rs"), "```")]
///
/// ## Differentiate a loss on a picture
#[doc = concat!("```ignore\n", include_str!("../tests/examples/gradient_of_a_picture.rs"), "```")]
///
/// ## Reconstruct a volume from its pictures
#[doc = concat!("```ignore\n", include_str!("../tests/examples/reconstruct.rs"), "```")]
pub mod library {}

#[doc = include_str!("guide/looking.md")]
pub mod looking {}

#[doc = include_str!("guide/own-loss.md")]
pub mod own_loss {}

#[doc = include_str!("guide/paths.md")]
pub mod paths {}

#[doc = include_str!("guide/planning.md")]
pub mod planning {}

#[doc = include_str!("guide/python.md")]
pub mod python {}

#[doc = include_str!("guide/reconstruction.md")]
pub mod reconstruction {}

#[doc = include_str!("guide/scans.md")]
pub mod scans {}

#[doc = include_str!("guide/scattering.md")]
pub mod scattering {}

#[doc = include_str!("guide/self-test.md")]
pub mod self_test {}

#[doc = include_str!("guide/shell.md")]
pub mod shell {}

#[doc = include_str!("guide/torch.md")]
pub mod torch {}

#[doc = include_str!("guide/transfer-functions.md")]
pub mod transfer_functions {}

#[doc = include_str!("guide/usd.md")]
pub mod usd {}

#[doc = include_str!("guide/usd-authoring.md")]
pub mod usd_authoring {}

#[doc = include_str!("guide/volumes.md")]
pub mod volumes {}
