//! Command line of gltf-lod: parse, run, exit code.

mod cli;

fn main() -> std::process::ExitCode {
    cli::run(&cli::parse())
}
