//! Commands: from arguments to library calls, output and exit code.

use super::args::{Bench, Build, Cli, Command, Compare, Init, Inspect, Papers, Progressive, Rebuild, TrainW};
use super::instruments::Process;
use super::progress::{Progress, write_line};
use anyhow::Context;
use clap::Parser;
use gltf_lod::asset::Limits;
use gltf_lod::bench::{BenchOptions, Instruments, describe_bench};
use gltf_lod::discover::directory_of;
use gltf_lod::emit::{self, Content, Output, OutputFile};
use gltf_lod::preset::{self, Flags};
use gltf_lod::report::{self, Detail, Outcome, Report};
use gltf_lod::{BuildOptions, Error, Kind, PapersOptions, ProgressiveOptions, RebuildOptions, TrainOptions};
use std::io::{ErrorKind, Write};
use std::path::Path;
use std::process::ExitCode;

const GATE_FAILED: u8 = 1;
const USAGE: u8 = 2;
const TROUBLE: u8 = 3;

/// Parses the command line; wrong usage ends the program with exit code 2.
pub fn parse() -> Cli {
    Cli::parse()
}

/// Runs the command and gives its exit code.
pub fn run(cli: &Cli) -> ExitCode {
    let result = match &cli.command {
        Command::Build(args) => build(args),
        Command::Inspect(args) => inspect(args),
        Command::Compare(args) => compare(args),
        Command::Progressive(args) => progressive(args),
        Command::Rebuild(args) => rebuild(args),
        Command::Bench(args) => bench(args),
        Command::Init(args) => init(args),
        Command::Presets => list_presets(),
        Command::TrainW(args) => train_w(args),
        Command::Papers(args) => papers(args),
    };
    ExitCode::from(result.unwrap_or_else(|error| report_failure(&error)))
}

fn build(args: &Build) -> anyhow::Result<u8> {
    keep_panics_quiet(args.run.verbose);
    let options = BuildOptions {
        inputs: args.inputs.clone(),
        output: args.output.clone(),
        in_place: args.in_place,
        flags: args.preset.flags(),
        limits: Limits::default(),
        jobs: args.run.jobs,
        dry_run: args.dry_run,
    };
    let progress = Progress::new(args.run.quiet);
    let report = gltf_lod::build(&options, &progress);
    progress.finish();
    let report = report?;
    if !args.run.quiet {
        let detail = if args.run.verbose { Detail::Meshes } else { Detail::Files };
        print(&report::describe_run(&report, detail))?;
        let warnings = report.files.iter().flat_map(|file| &file.warnings);
        warnings.for_each(|warning| write_line(&format!("warning: {}", warning.error)));
    }
    // One line each, whatever is in them: logs of thousands of files are read by tools.
    report.errors().for_each(|problem| write_line(&format!("error: {}", problem.error)));
    print_failed_gates(&report, args.run.quiet);
    if let Some(file) = &args.report {
        write_file(file, report::to_json(&report, !args.no_times))?;
    }
    Ok(code_of(report.outcome()))
}

fn code_of(outcome: Outcome) -> u8 {
    match outcome {
        Outcome::Fine => 0,
        Outcome::GateFailed => GATE_FAILED,
        Outcome::Preset => USAGE,
        Outcome::Trouble => TROUBLE,
    }
}

/// The summary shows them too; without it they are all that says why the exit code is 1.
fn print_failed_gates(report: &Report, quiet: bool) {
    for file in report.files.iter().filter(|_| quiet) {
        for gate in file.gates.iter().filter(|gate| gate.fails) {
            write_line(&format!("gate failed: {}: {}", file.path, gate.message));
        }
    }
}

fn inspect(args: &Inspect) -> anyhow::Result<u8> {
    let inspection = gltf_lod::inspect(&args.file, &Limits::default())?;
    if args.json {
        print_json(&inspection)?;
    } else {
        print(&report::describe_inspection(&inspection))?;
    }
    Ok(0)
}

fn compare(args: &Compare) -> anyhow::Result<u8> {
    keep_panics_quiet(args.run.verbose);
    let options = BuildOptions { flags: args.preset.flags(), jobs: args.run.jobs, ..BuildOptions::default() };
    let progress = Progress::new(args.run.quiet || args.json);
    let file = gltf_lod::compare(&args.file, &options, &progress);
    progress.finish();
    let file = file?;
    if args.json {
        print_json(&file)?;
    } else {
        print(&report::describe_comparison(&file))?;
    }
    Ok(0)
}

fn progressive(args: &Progressive) -> anyhow::Result<u8> {
    let flags = Flags {
        config: args.config.clone(),
        preset: args.preset.clone(),
        algorithm: args.algorithm.clone(),
        ..Flags::default()
    };
    let options = ProgressiveOptions {
        input: args.file.clone(),
        output: args.output.clone(),
        base: args.base,
        flags,
        limits: Limits::default(),
        jobs: args.jobs,
    };
    let report = gltf_lod::progressive(&options)?;
    report.warnings.iter().for_each(|warning| write_line(&format!("warning: {warning}")));
    if args.json {
        print_json(&report)?
    } else {
        print(&report::describe_progressive(&report))?
    }
    Ok(0)
}

fn rebuild(args: &Rebuild) -> anyhow::Result<u8> {
    let options = RebuildOptions {
        input: args.file.clone(),
        output: args.output.clone(),
        triangles: args.triangles,
        limits: Limits::default(),
        jobs: args.jobs,
    };
    let report = gltf_lod::rebuild(&options)?;
    report.warnings.iter().for_each(|warning| write_line(&format!("warning: {warning}")));
    if args.json {
        print_json(&report)?
    } else {
        print(&report::describe_rebuild(&report))?
    }
    Ok(0)
}

fn bench(args: &Bench) -> anyhow::Result<u8> {
    keep_panics_quiet(args.run.verbose);
    let options = BenchOptions {
        inputs: args.inputs.clone(),
        flags: args.preset.flags(),
        limits: Limits::default(),
        jobs: args.run.jobs,
        runs: args.runs.map(usize::from),
    };
    let progress = Progress::new(args.run.quiet || args.json);
    let report = gltf_lod::bench::bench(&options, &Process::start(), &progress);
    progress.finish();
    let report = report?;
    if args.json {
        print_json(&report)?;
    } else {
        print(&describe_bench(&report, args.run.verbose))?;
    }
    report.problems.iter().for_each(|problem| write_line(&format!("error: {}", problem.error)));
    Ok(code_of(report.outcome()))
}

fn init(args: &Init) -> anyhow::Result<u8> {
    let file = args.directory.join(preset::FILE_NAME);
    if file.exists() && !args.force {
        let error = Error::new(Kind::Preset, "the file is there already").in_file(&file);
        return Err(error.help("replace it with --force").into());
    }
    write_file(&file, preset::init_text())?;
    print(&format!("{} written\n", file.display()))?;
    Ok(0)
}

fn list_presets() -> anyhow::Result<u8> {
    for preset in preset::list() {
        print(&format!("{:10} {}\n{:10} levels: {}\n", preset.name, preset.description, "", preset.levels))?;
    }
    Ok(0)
}

fn train_w(args: &TrainW) -> anyhow::Result<u8> {
    let read = |file: &Path| std::fs::read_to_string(file).map_err(|error| Error::io(file, &error));
    let options = TrainOptions {
        meshes: args.meshes.clone(),
        generated: args.generated,
        reductions: args.reductions,
        seed: args.seed,
        samples: args.from_samples.as_deref().map(read).transpose()?,
        command: describe_training_command(args),
        limits: Limits::default(),
        jobs: args.run.jobs,
    };
    let progress = Progress::new(args.run.quiet);
    let outcome = gltf_lod::train_w(&options, &progress);
    progress.finish();
    let outcome = outcome?;
    write_file(&args.output, outcome.weights.to_text())?;
    if let Some(file) = &args.samples {
        write_file(file, outcome.samples)?;
    }
    if !args.run.quiet {
        print(&report::describe_training(&outcome.report))?;
    }
    Ok(0)
}

/// The command as it would be typed again: what decides about the result, and where it goes.
fn describe_training_command(args: &TrainW) -> String {
    let mut words = vec!["gltf-lod train-w".to_owned()];
    words.extend(args.meshes.iter().map(|file| file.display().to_string()));
    words.extend((args.generated > 0).then(|| format!("--generated {}", args.generated)));
    words.extend((args.reductions != 40).then(|| format!("--reductions {}", args.reductions)));
    words.push(format!("--seed {} -o {}", args.seed, args.output.display()));
    words.extend(args.samples.iter().map(|file| format!("--samples {}", file.display())));
    words.extend(args.from_samples.iter().map(|file| format!("--from-samples {}", file.display())));
    words.join(" ")
}

fn papers(args: &Papers) -> anyhow::Result<u8> {
    let options = PapersOptions {
        models: args.models.clone(),
        runs: args.runs,
        most_triangles: args.most_triangles,
        limits: Limits::default(),
    };
    let process = Process::start();
    let progress = Progress::new(args.quiet || args.json);
    let found = gltf_lod::papers(&options, &|| process.cpu(), &progress);
    progress.finish();
    let found = found?;
    if args.json {
        print_json(&found)?;
    } else {
        print(&report::describe_papers(&found))?;
    }
    Ok(0)
}

/// A broken invariant becomes an error of its file; where it broke interests who reports it.
fn keep_panics_quiet(verbose: bool) {
    std::panic::set_hook(Box::new(move |panic| {
        if verbose {
            write_line(&panic.to_string());
        }
    }));
}

/// Writes through a temporary file, like every output.
fn write_file(file: &Path, content: impl Into<Vec<u8>>) -> anyhow::Result<()> {
    let name = file.file_name().with_context(|| format!("{}: names no file", file.display()))?;
    let output = OutputFile { relative: name.into(), content: Content::Bytes(content.into()) };
    Ok(emit::write(&Output { files: vec![output], notes: Vec::new() }, directory_of(file))?)
}

fn print_json(value: &impl serde::Serialize) -> anyhow::Result<()> {
    print(&(serde_json::to_string_pretty(value)? + "\n"))
}

/// A reader that has seen enough (`| head`) is no failure.
fn print(text: &str) -> anyhow::Result<()> {
    let mut stdout = std::io::stdout().lock();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(error).context("cannot write to stdout"),
        _ => Ok(()),
    }
}

/// What ends a run is told with room: what is wrong, then what to do.
fn report_failure(error: &anyhow::Error) -> u8 {
    let Some(known) = error.downcast_ref::<Error>() else {
        write_line(&format!("error: {error:#}"));
        return TROUBLE;
    };
    write_line(&format!("error: {}", Error { help: None, ..known.clone() }));
    if let Some(help) = &known.help {
        write_line(&format!("  help: {help}"));
    }
    if known.kind == Kind::Preset { USAGE } else { TROUBLE }
}
