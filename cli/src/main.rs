//! The command `pliant`; [`pliant_cli`] contains everything.

fn main() -> std::process::ExitCode {
    pliant_cli::main()
}
