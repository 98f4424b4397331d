//! `voxsplat completions` and `voxsplat man`: both from the definitions of the arguments.

use clap_complete::Shell;
use clap_mangen::Man;

use super::args;
use super::failure::{Failure, refuse};
use super::output;

/// Prints the completions of a shell.
pub(crate) fn completions(shell: Shell) -> Result<(), Failure> {
    let mut text = Vec::new();
    clap_complete::generate(shell, &mut args::command(), "voxsplat", &mut text);
    output::print_bytes(&text)
}

/// Prints the manual page of the program, or of a command.
pub(crate) fn page(command: Option<&str>) -> Result<(), Failure> {
    let program = args::built();
    let page = match command {
        None => Man::new(program),
        Some(name) => {
            let known: Vec<String> = program.get_subcommands().map(|command| command.get_name().to_owned()).collect();
            let Some(command) = program.find_subcommand(name) else {
                return refuse(format!("man: {name:?}, expected one of {}", known.join(", ")));
            };
            Man::new(command.clone()).title(format!("voxsplat-{name}"))
        }
    };
    let mut text = Vec::new();
    page.render(&mut text).map_err(|e| Failure::failed(format!("cannot write the manual page: {e}")))?;
    output::print_bytes(&text)
}
