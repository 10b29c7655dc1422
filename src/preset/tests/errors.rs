//! Every class of mistake: its place, its carets, its way out.

use super::*;

#[test]
fn a_message_shows_the_line_with_carets_and_the_way_out() {
    let (place, picture) = error_in("levels = [0.5]\nscreen_hight = 720 # Höhe\n");
    assert_eq!(place, "line 2, column 1");
    assert_eq!(
        picture,
        "unknown key `screen_hight`
  |
2 | screen_hight = 720 # Höhe
  | ^^^^^^^^^^^^
  |
  = help: did you mean `screen_height`?"
    );
}

#[test]
fn columns_count_characters_and_carets_count_cells() {
    let (place, picture) = error_in("\u{feff}description = \"äöü漢字🦀\" oops\n");
    assert_eq!(place, "line 1, column 24");
    // 漢, 字 and 🦀 are two cells wide.
    let caret = picture.lines().nth(3).unwrap();
    assert_eq!(caret, format!("  | {}^", " ".repeat(23 + 3)));
    let (place, _) = error_in("description = \"a\"\r\n\r\n[preset.\"漢字\"]\r\nextends = [\"möbel\", \"wände\"]\r\n");
    assert_eq!(place, "line 4, column 12");
}

#[test]
fn every_class_points_at_its_place_and_says_what_to_write() {
    let cases = [
        // Unknown keys and words.
        ("ratio = 0.5", "1:1", 5, "unknown key `ratio`", "did you mean `levels`?"),
        ("[[level]]\nratio = 0.5", "1:3", 5, "unknown key `level`", "did you mean `levels`?"),
        ("[[levels]]\nrato = 0.5", "2:1", 4, "unknown key `rato`", "did you mean `ratio`?"),
        ("[[rules]]\nmesh = 'a'", "1:3", 5, "unknown key `rules`", "did you mean `rule`?"),
        ("[[rule]]\nmaterail = 'a'", "2:1", 8, "unknown key `materail`", "did you mean `material`?"),
        ("[gates]\nmax_eror = 3", "2:1", 8, "unknown key `max_eror`", "did you mean `max_error`?"),
        (
            "[gates]\nspeed = 3",
            "2:1",
            5,
            "unknown key `speed`",
            "there is `max_error`, `max_rms_vs_meshopt`, `max_gap_edges`",
        ),
        ("attribute_weights = { uv = 1 }", "1:23", 2, "unknown key `uv`", "there is `normal`, `tex_coord`, `color`"),
        ("[preset.a]\nlevles = []", "2:1", 6, "unknown key `levles`", "did you mean `levels`?"),
        ("algorithm = 'esqm'", "1:13", 6, "unknown value `esqm`", "did you mean `esqem`?"),
        ("border = 'locked'", "1:10", 8, "unknown value `locked`", "did you mean `lock`?"),
        ("layout = 'appended'", "1:10", 10, "unknown value `appended`", "did you mean `append`?"),
        // Types.
        ("algorithm = 3", "1:13", 1, "expected a word in quotes", ""),
        ("algorithm = qem", "1:13", 3, "text must stand in quotes", ""),
        ("skip = 'yes'", "1:8", 5, "expected true or false, found `'yes'`", ""),
        ("skip =", "1:7", 1, "a value is missing", ""),
        ("screen_height = '4k'", "1:17", 4, "expected a number from 1 to 100000, found `'4k'`", ""),
        ("levels = 0.5", "1:10", 3, "expected a list of levels such as [0.5, 0.25]", ""),
        ("levels = ['half']", "1:11", 6, "expected a level: a share of the triangles", ""),
        ("[rule]\nmesh = 'a'", "1:1", 6, "expected a table `[[rule]]` with double brackets", ""),
        ("[levels]\nratio = 0.5", "1:1", 8, "expected a list of levels such as [0.5, 0.25]", ""),
        ("extends = 3", "1:11", 1, "expected a string or a list of strings, found `3`", ""),
        ("samples = 1000.5", "1:11", 6, "expected a whole number from 100 to 10000000, found `1000.5`", ""),
        // Ranges.
        ("pixel_tolerance = 0", "1:19", 1, "expected a number above 0 and at most 1000, found `0`", ""),
        ("cull_coverage = nan", "1:17", 3, "expected a number from 0 to 0.99, found `nan`", ""),
        ("min_triangles = 0", "1:17", 1, "expected a whole number from 1, found `0`", ""),
        ("min_triangles = 99999999999999999999", "1:17", 20, "expected a whole number from 1, found", ""),
        ("qfvp_w = 2.5", "1:10", 3, "expected a number from 0 to 2, \"auto\" or \"shape\", found `2.5`", ""),
        ("schedule = 'vertexes'", "1:12", 10, "unknown value `vertexes`", "did you mean `vertices`?"),
        ("split_factor = 0.5", "1:16", 3, "expected a number from 1 to 100, or false for no splits, found `0.5`", ""),
        (
            "levels = [500]",
            "1:11",
            3,
            "is a share of the triangles",
            "for a number of triangles write { triangles = 500 }",
        ),
        ("levels = [{ triangles = 0 }]", "1:25", 1, "expected a whole number from 1, found `0`", ""),
        ("levels = [{ error = '0.5' }]", "1:21", 5, "such as \"0.5%\", found `'0.5'`", ""),
        ("[gates]\nmax_error = true", "2:13", 4, "expected a limit, a table such as", ""),
        (
            "[gates]\nmax_error = { value = '1%', on = 'fial' }",
            "2:34",
            6,
            "unknown value `fial`",
            "did you mean `fail`?",
        ),
        ("[gates]\nmax_error = { on = 'fail' }", "2:13", 15, "missing key `value`", ""),
        ("[gates]\nmax_gap_edges = -1", "2:17", 2, "expected a whole number from 0, found `-1`", ""),
        // Values that do not fit together.
        ("levels = [0.5, 0.6]", "1:16", 3, "by its `ratio` this level is finer", "levels go from fine to coarse"),
        ("levels = [0.5, 0.5]", "1:16", 3, "by its `ratio` this level equals", "levels go from fine to coarse"),
        ("[[levels]]\nratio = 0.5\n[[levels]]\nratio = 0.6", "3:1", 10, "this level is finer", "fine to coarse"),
        ("levels = [{ error = '1%' }, { error = '0.5%' }]", "1:29", 18, "by its `error` this level is finer", ""),
        ("levels = [{}]", "1:11", 2, "this level has no rule that ends it", "add `ratio`, `triangles`"),
        ("levels = [{ pixels = 1 }]", "1:11", 14, "`pixels` needs `at`", "`at = 0.25`"),
        ("levels = [{ ratio = 0.5, at = 1 }]", "1:11", 23, "`at` belongs to `pixels`", ""),
        ("coverage = [0.5, 0.5]", "1:18", 3, "coverage has to fall", ""),
        ("coverage = [0.5, 0.2]", "1:12", 10, "2 coverage numbers for 3 levels", "one number for each level"),
        ("coverage = [0.5, 0.2, 0.1]\ncull_coverage = 0.1", "1:12", 15, "the last level would be culled", ""),
        (
            "seam = 'lock'\nalgorithm = 'meshopt'",
            "2:13",
            9,
            "meshoptimizer cannot keep `seam = \"lock\"`",
            "choose another algorithm",
        ),
        ("naming = '{nam}_{level}'", "1:10", 15, "unknown word `{nam}`", "`{name}` and `{level}`"),
        ("naming = '{name}_LOD'", "1:10", 12, "all levels would have the same name", "add `{level}`"),
        // Patterns and rules.
        ("[[rule]]\nmesh = 'a['\nskip = true", "2:8", 4, "not a pattern: unclosed character class", "`[[]`"),
        ("[[rule]]\npath = ['a', '../b']\nskip = true", "2:14", 6, "cannot leave it", "higher up"),
        ("copy = ['a', 'b\\c']", "1:14", 5, "`/` between directories", ""),
        ("[[rule]]\nskip = true", "1:1", 8, "this rule has no condition", "add `path`, `node`"),
        ("[[rule]]\nmesh = 'a'", "1:1", 8, "this rule sets nothing", "`skip = true`"),
        (
            "[[rule]]\nmesh = 'a'\nlayout = 'append'",
            "3:10",
            8,
            "`layout` holds for whole files",
            "only condition is `path`",
        ),
        // Names.
        ("extends = 'mobil'", "1:11", 7, "unknown preset `mobil`", "did you mean `mobile`?"),
        ("extends = ['mobile', 'xyz']", "1:22", 5, "unknown preset `xyz`", "there is `character`, `default`"),
        ("[preset.tablet]\nextends = 'tablett'", "2:11", 9, "unknown preset `tablett`", "did you mean `tablet`?"),
        ("[[rule]]\npath = 'z/**'\nextends = 'her'", "3:11", 5, "unknown preset `her`", "did you mean `hero`?"),
        ("[preset.mobile]\nskip = true", "1:9", 6, "`mobile` is a built-in preset", "choose another name"),
        ("[preset.a]\nextends = 'a'", "2:11", 3, "in a circle: a → a", "remove one `extends`"),
        ("[preset.a]\nextends='b'\n[preset.b]\nextends=['hero', 'a']", "4:18", 3, "in a circle: a → b → a", ""),
        // TOML itself.
        ("levels = [0.5\nskip = true", "2:1", 1, "missing comma between array elements", ""),
        ("skip = true\nskip = true", "2:1", 4, "duplicate key", ""),
    ];
    for (text, place, carets, title, help) in cases {
        let (found, picture) = error_in(text);
        let (line, column) = place.split_once(':').unwrap();
        assert_eq!(found, format!("line {line}, column {column}"), "{text}\n{picture}");
        let first = picture.lines().next().unwrap();
        assert!(first.contains(title), "{text}\n{picture}");
        let margin = " ".repeat(column.parse::<usize>().unwrap());
        let caret_line = format!("  |{margin}{}", "^".repeat(carets));
        assert_eq!(picture.lines().find(|line| line.contains('^')), Some(caret_line.as_str()), "{text}\n{picture}");
        match help {
            "" => {}
            help => assert!(
                picture.lines().any(|line| line.contains("= help: ") && line.contains(help)),
                "{text}\n{picture}"
            ),
        }
    }
}

#[test]
fn files_that_are_no_text_are_named() {
    let root = directory(&[]);
    let presets = Presets::new(&Flags::default()).unwrap();
    fs::create_dir(root.path().join("a")).unwrap();
    fs::write(root.path().join("a").join(FILE_NAME), b"description = \"\xe4\"\n").unwrap();
    let error = presets.for_asset(root.path(), Path::new("a/a.glb")).unwrap_err();
    assert_eq!(error.place.as_deref(), Some("line 1, column 16"));
    assert!(error.message.starts_with("this is not UTF-8"), "{error}");

    fs::create_dir_all(root.path().join("b").join(FILE_NAME)).unwrap();
    let error = presets.for_asset(root.path(), Path::new("b/b.glb")).unwrap_err();
    assert_eq!(error.kind, crate::Kind::Io);

    fs::create_dir(root.path().join("d")).unwrap();
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("nowhere.toml", root.path().join("d").join(FILE_NAME)).unwrap();
        let error = presets.for_asset(root.path(), Path::new("d/d.glb")).unwrap_err();
        assert_eq!(error.kind, crate::Kind::Io, "a link to nowhere is a mistake, not an absent file");
    }

    fs::create_dir(root.path().join("c")).unwrap();
    fs::write(root.path().join("c").join(FILE_NAME), "#".repeat((1 << 20) + 1)).unwrap();
    let error = presets.for_asset(root.path(), Path::new("c/c.glb")).unwrap_err();
    assert_eq!(error.kind, crate::Kind::Limit);
}

#[test]
fn flags_are_named() {
    let error = |flags: Flags| read_with(&flags, &[], "a.glb").unwrap_err().to_string();
    let levels = |levels: &[f64]| error(Flags { levels: Some(levels.to_vec()), ..Flags::default() });
    assert!(levels(&[0.5, 0.7]).starts_with("--levels: by its `ratio` this level is finer"), "{}", levels(&[0.5, 0.7]));
    assert!(levels(&[0.0]).starts_with("--levels: expected a level"), "{}", levels(&[0.0]));
    let algorithm = error(Flags { algorithm: Some("qme".into()), ..Flags::default() });
    assert_eq!(algorithm, "--algorithm: unknown value `qme` (help: did you mean `qem`?)");
    let preset = error(Flags { preset: Some("moble".into()), ..Flags::default() });
    assert_eq!(preset, "--preset: unknown preset `moble` (help: did you mean `mobile`?)");
    let config = error(Flags { config: Some("no/such.toml".into()), ..Flags::default() });
    assert!(config.starts_with("no/such.toml: no such file"), "{config}");
}

#[test]
fn presets_that_double_at_every_step_are_refused() {
    let mut text = String::new();
    for step in 0..40 {
        text += &format!(
            "[preset.a{step}]\nextends = ['a{0}', 'b{0}']\n[preset.b{step}]\nextends = ['a{0}', 'b{0}']\n",
            step + 1
        );
    }
    text += "[preset.a40]\n[preset.b40]\n";
    assert!(error_in(&text).1.contains("more than 1000 presets"));
}

#[test]
fn deep_nesting_is_an_error() {
    let (place, _) = error_in(&format!("levels = {}", "[".repeat(100_000)));
    assert!(place.starts_with("line 1,"));
}

#[test]
fn a_file_of_one_huge_line_is_refused_in_short() {
    let (place, picture) = error_in(&format!("levels = [0.5]{} oops", " ".repeat(1_000_000)));
    assert_eq!(place, "line 1, column 1000016");
    assert!(picture.len() < 2000, "{}", picture.len());
    let (_, picture) = error_in(&format!("{}{} = 1", "\n".repeat(500_000), "x".repeat(500_000)));
    assert!(picture.len() < 4000, "{}", picture.len());
}
