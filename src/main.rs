//! The command `pliant`; everything is in [`pliant::cli`].

fn main() -> std::process::ExitCode {
    pliant::cli::main()
}
