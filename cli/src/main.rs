//! The command `pliant`; everything is in [`pliant_cli`].

fn main() -> std::process::ExitCode {
    pliant_cli::main()
}
