//! The command line as validated options.

use crate::Failure;

/// What to do.
#[derive(Debug, PartialEq, Eq)]
pub enum Command {
    Help,
    Demo(DemoOptions),
    Test(TestOptions),
    Bless {
        name: String,
    },
    Scale(ScaleOptions),
    Targets,
    /// Handed on as they are to the program that does it.
    Fuzz {
        arguments: Vec<String>,
    },
    /// The same.
    Report {
        arguments: Vec<String>,
    },
    /// The same.
    Pictures {
        arguments: Vec<String>,
    },
    /// The same.
    Bench {
        arguments: Vec<String>,
    },
    /// The same.
    Soak {
        arguments: Vec<String>,
    },
    Sanitize {
        /// With Miri instead of AddressSanitizer.
        with_miri: bool,
    },
}

#[derive(Debug, PartialEq, Eq)]
pub struct ScaleOptions {
    /// Counts as `hlod-build synth` reads them.
    pub triangles: Vec<String>,
    /// As `hlod-build build --memory` reads it.
    pub memory: String,
    pub may_install: bool,
}

#[derive(Debug, PartialEq, Eq)]
pub struct DemoOptions {
    /// A count as `hlod-build synth` reads it; also part of file names.
    pub triangles: String,
    /// Write pictures even where there is a display.
    pub headless: bool,
    pub may_install: bool,
}

#[derive(Debug, PartialEq, Eq)]
pub struct TestOptions {
    pub may_install: bool,
    /// Parts of names of tests; none means everything.
    pub filters: Vec<String>,
}

/// Reads the command line, without the program's own name.
pub fn parse(arguments: impl IntoIterator<Item = String>) -> Result<Command, Failure> {
    let mut arguments = arguments.into_iter();
    let Some(command) = arguments.next() else { return Ok(Command::Help) };
    match command.as_str() {
        "demo" => demo(arguments).map(Command::Demo),
        "test" => test(arguments).map(Command::Test),
        "bless" => bless(arguments),
        "scale" => scale(arguments).map(Command::Scale),
        "targets" => arguments.next().map_or(Ok(Command::Targets), |a| Err(unexpected(&a))),
        "report" => Ok(Command::Report { arguments: arguments.collect() }),
        "bench" => Ok(Command::Bench { arguments: arguments.collect() }),
        "pictures" => Ok(Command::Pictures { arguments: arguments.collect() }),
        "fuzz" => Ok(Command::Fuzz { arguments: arguments.collect() }),
        "sanitize" => sanitize(arguments),
        "soak" => Ok(Command::Soak { arguments: arguments.collect() }),
        "help" | "-h" | "--help" => Ok(Command::Help),
        _ => Err(Failure::Usage(format!("There is no command '{command}'."))),
    }
}

fn demo(mut arguments: impl Iterator<Item = String>) -> Result<DemoOptions, Failure> {
    let mut options = DemoOptions { triangles: "1M".into(), headless: false, may_install: true };
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--no-install" => options.may_install = false,
            "--headless" => options.headless = true,
            "--triangles" => options.triangles = count(arguments.next())?,
            _ => return Err(unexpected(&argument)),
        }
    }
    Ok(options)
}

fn test(arguments: impl Iterator<Item = String>) -> Result<TestOptions, Failure> {
    let mut options = TestOptions { may_install: true, filters: Vec::new() };
    for argument in arguments {
        match argument.as_str() {
            "--no-install" => options.may_install = false,
            _ if argument.starts_with('-') => return Err(unexpected(&argument)),
            _ => options.filters.push(argument),
        }
    }
    Ok(options)
}

fn scale(mut arguments: impl Iterator<Item = String>) -> Result<ScaleOptions, Failure> {
    let (mut triangles, mut memory, mut may_install) = (Vec::new(), "512MiB".to_owned(), true);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--no-install" => may_install = false,
            "--triangles" => triangles.push(count(arguments.next())?),
            "--memory" => {
                let missing = || Failure::Usage("--memory takes a size such as 512MiB.".into());
                memory = arguments.next().ok_or_else(missing)?;
            }
            _ => return Err(unexpected(&argument)),
        }
    }
    if triangles.is_empty() {
        triangles = ["1M", "4M", "16M"].map(str::to_owned).to_vec();
    }
    Ok(ScaleOptions { triangles, memory, may_install })
}

fn bless(mut arguments: impl Iterator<Item = String>) -> Result<Command, Failure> {
    match (arguments.next(), arguments.next()) {
        (Some(name), None) if !name.is_empty() && !name.starts_with('-') => {
            Ok(Command::Bless { name })
        }
        // An empty name would replace every golden there is.
        _ => Err(Failure::Usage("bless takes one name of an image test, or a part of it.".into())),
    }
}

fn sanitize(mut arguments: impl Iterator<Item = String>) -> Result<Command, Failure> {
    let argument = arguments.next();
    let with_miri = argument.as_deref() == Some("--miri");
    match argument.filter(|_| !with_miri).or(arguments.next()) {
        None => Ok(Command::Sanitize { with_miri }),
        Some(other) => Err(unexpected(&other)),
    }
}

/// Digits with an optional K or M, which is also safe as part of a file's name.
fn count(argument: Option<String>) -> Result<String, Failure> {
    let text = argument.unwrap_or_default();
    let digits = text.strip_suffix(['K', 'M']).unwrap_or(&text);
    if digits.is_empty() || digits.starts_with('0') || !digits.chars().all(|c| c.is_ascii_digit()) {
        return Err(Failure::Usage("--triangles takes a count such as 300K or 8M.".into()));
    }
    Ok(text)
}

fn unexpected(argument: &str) -> Failure {
    Failure::Usage(format!("'{argument}' was not expected here."))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(line: &str) -> Option<Command> {
        parse(line.split_whitespace().map(str::to_owned)).ok()
    }

    #[test]
    fn commands_and_their_options() {
        assert_eq!(parsed(""), Some(Command::Help));
        assert_eq!(parsed("--help"), Some(Command::Help));
        assert_eq!(
            parsed("demo --triangles 300K --headless --no-install"),
            Some(Command::Demo(DemoOptions {
                triangles: "300K".into(),
                headless: true,
                may_install: false
            }))
        );
        assert_eq!(
            parsed("test decode --no-install cracks"),
            Some(Command::Test(TestOptions {
                may_install: false,
                filters: vec!["decode".into(), "cracks".into()]
            }))
        );
        assert_eq!(
            parsed("scale --triangles 2M --triangles 8M --memory 1GiB"),
            Some(Command::Scale(ScaleOptions {
                triangles: vec!["2M".into(), "8M".into()],
                memory: "1GiB".into(),
                may_install: true
            }))
        );
        let arguments = vec!["--seconds".to_owned(), "5".into(), "ply".into()];
        assert_eq!(parsed("fuzz --seconds 5 ply"), Some(Command::Fuzz { arguments }));
        assert_eq!(parsed("sanitize"), Some(Command::Sanitize { with_miri: false }));
        assert_eq!(parsed("sanitize --miri"), Some(Command::Sanitize { with_miri: true }));
        assert_eq!(parsed("bless igea"), Some(Command::Bless { name: "igea".into() }));
    }

    #[test]
    fn wrong_usage_is_refused() {
        for line in [
            "tset",
            "sanitize --mini",
            "sanitize --miri ply",
            "demo statue",
            "demo --triangles",
            "demo --triangles ../x",
            "demo --triangles 0",
            "demo --triangles M",
            "test --release",
            "bless",
            "bless igea bunny",
            "bless --all",
            "scale 8M",
            "scale --memory",
        ] {
            assert_eq!(parsed(line), None, "{line}");
        }
    }
}
