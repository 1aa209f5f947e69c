//! Lists, matrices, structs and strings, and in which versions they exist.

use super::{Run, failure, said_by, say};
use crate::ur5::{Series, urscript};

/// What a program of these lines says on an e-Series of software 5.15.
fn say_5_15(lines: &str) -> Vec<String> {
    said_by(lines, Series::E, "5.15.0")
}

fn refused(lines: &str, version: &str) -> String {
    let text = format!("def test():\n{lines}\nend\n");
    urscript::compile(&text, version.parse().unwrap())
        .unwrap_err()
        .to_string()
}

#[test]
fn arithmetic_of_lists_goes_element_by_element() {
    assert_eq!(say("textmsg([1, 2] + [10, 20])"), ["[11, 22]"]);
    assert_eq!(say("textmsg(-3 * [1, 2])"), ["[-3, -6]"]);
    assert_eq!(say("textmsg([1, 2] / 2)"), ["[0.5, 1]"]);
    assert_eq!(say("textmsg(-[1, 2])"), ["[-1, -2]"]);
    assert_eq!(
        failure("a = [1, 2] + [1]"),
        "line 2: lists of 2 and 1 elements"
    );
}

#[test]
fn matrices_multiply_as_matrices() {
    let lines = "
      m = [[1, 2], [3, 4]]
      textmsg(m * [1, 1])
      textmsg(m * [[0, 1], [1, 0]])
      textmsg(m[1, 0])
      m[0, 1] = 5
      textmsg(transpose(m))
      textmsg(inv([[2, 0], [0, 4]])[1, 1])
      textmsg(size(m))";
    assert_eq!(
        say(lines),
        [
            "[3, 7]",
            "[[2, 1], [4, 3]]",
            "3",
            "[[1, 3], [5, 4]]",
            "0.25",
            "[2, 2]"
        ]
    );
    assert!(failure("a = inv([[1, 1], [1, 1]])").contains("singular"));
    assert!(failure("a = [[1, 2]] * [[1, 2]]").contains("1x2 and 1x2"));
}

#[test]
fn structs_have_members_that_can_be_changed() {
    let lines = "
      s = struct(q=[1, 2, 3], name=\"home\")
      s.q[1] = 20
      s.name = str_cat(s.name, \"!\")
      textmsg(s.q[1], s.name)
      t = [s, s]
      t[0].name = \"other\"
      textmsg(t[0].name, t[1].name)";
    assert_eq!(say_5_15(lines), ["20home!", "otherhome!"]);
    assert_eq!(
        refused("s = struct(a=1)", "3.15.8"),
        "line 2: struct() is not available in version 3.15.8.0"
    );
    assert!(refused("s = struct(a=1, a=2)", "5.15.0").contains("twice"));
}

#[test]
fn a_list_grows_as_far_as_its_capacity() {
    let lines = "
      l = make_list(1, 7, 3)
      l.append(8)
      l.insert(0, 6)
      textmsg(l, l.length())
      textmsg(l.pop())
      textmsg(l.remove(0), l.to_string())
      l.extend([1, 2])
      textmsg(l.slice(1), l.capacity())
      l.clear()
      textmsg(get_list_length(l))
      l.append(1)
      l.append(1)
      l.append(1)
      l.append(1)";
    let run = Run::on(
        &format!("def test():\n{lines}\nend"),
        100,
        Series::E,
        "5.15.0",
    );
    assert_eq!(run.said(), ["[6, 7, 8]3", "8", "6[7]", "[1, 2]3", "0"]);
    let Some(urscript::Ending::Failed(error)) = run.ending else {
        panic!("{:?}", run.ending);
    };
    assert_eq!(error.text, "a list of at most 3 elements is full");
    assert!(refused("l = [1]\nl.append(2)", "5.14.0").contains("append() is not available"));
}

#[test]
fn strings_are_counted_in_characters() {
    let lines = "
      s = \"Grüße\"
      textmsg(str_len(s), str_at(s, 2))
      textmsg(str_sub(s, 3, 2))
      textmsg(str_sub(s, 1))
      textmsg(str_find(s, \"ße\"))
      textmsg(str_find(s, \"G\", 1))
      textmsg(to_num(\"2.5\") + to_num(\"-3\"))";
    assert_eq!(say(lines), ["5ü", "ße", "rüße", "3", "-1", "-0.5"]);
    assert!(failure("a = str_at(\"abc\", 3)").contains("index 3 in 3 characters"));
}

#[test]
fn a_function_of_another_generation_is_refused_before_anything_runs() {
    assert_eq!(
        refused("get_freedrive_status()", "3.15.8"),
        "line 2: get_freedrive_status() is not available in version 3.15.8.0"
    );
    let text = "def test():\ntextmsg(get_freedrive_status())\nend";
    let run = Run::on(text, 100, Series::E, "5.12.6");
    assert_eq!(run.said(), ["0"]);
    assert!(refused("get_jacobian()", "5.22.0").contains("not available"));
}

#[test]
fn errors_point_at_line_and_column() {
    let error = urscript::compile(
        "def a():\n  x = 1 + frob(2)\nend",
        Series::Cb3.default_version(),
    )
    .unwrap_err();
    assert_eq!((error.line, error.column), (2, 11));
    let error =
        urscript::compile("def a():\n  x = €\nend", Series::Cb3.default_version()).unwrap_err();
    assert_eq!((error.line, error.column), (2, 7));
}

#[test]
fn a_program_cannot_fill_the_memory() {
    let lines = "
      big = [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]
      m = [big, big, big, big, big, big, big, big, big, big, big, big, big, big, big, big]
      n = [m, m, m, m, m, m, m, m, m, m, m, m, m, m, m, m]
      o = [n, n]";
    assert!(failure(lines).contains("at most 4096"));
    let recursion = "
      def hoard(level):
        local a = transpose(transpose([[1,2,3,4,5,6,7,8,9,10,11,12,13,14,15,16,17,18,19,20],[1]]))
        return hoard(level + 1)
      end
      hoard(0)";
    assert!(failure(recursion).contains("matrix"));
    assert!(failure("a = [[[[[1]]]]]").contains("at most 4 levels"));
}

#[test]
fn poses_turn_as_rotations_do() {
    let lines = "
      q = rpy2rotvec([0, 0, d2r(90)])
      textmsg(norm(rotvec2rpy(q) - [0, 0, d2r(90)]) < 1e-12)
      w = wrench_trans(p[1, 0, 0, 0, 0, 0], [0, 2, 0, 0, 0, 0])
      textmsg(norm(w - [0, 2, 0, 0, 0, -2]) < 1e-12)
      textmsg(point_dist(p[0, 3, 4, 0, 0, 0], p[0, 0, 0, 1, 0, 0]))";
    assert_eq!(say(lines), ["True", "True", "5"]);
}
