# Sourced by the scripts that run tests: says how far they are.
# shellcheck shell=sh

# Mesa's software driver 22.3.6 crashes once in thousands of pictures of `quads` (docs/hard-cases.md, Drivers), but not
# without threads of its own. Tests run side by side anyway. Tests of Python keep the driver's threads.
progress_threads=${LP_NUM_THREADS:-0}

progress_say() {
    echo "tests: $*" >&2
}

# Runs `cargo test` with these arguments, prints its output, and a line at each twentieth of the tests.
progress_tests() {
    case " $* " in
        *' -- '*) progress_count=$(cargo test --quiet "$@" --list 2>/dev/null | grep -c ': test$' || true) ;;
        *) progress_count=$(cargo test --quiet "$@" -- --list 2>/dev/null | grep -c ': test$' || true) ;;
    esac
    progress_status=$(mktemp) || setup_fail "cannot make a temporary file"
    {
        LP_NUM_THREADS=$progress_threads cargo test "$@" 2>&1 && echo 0 >"$progress_status"
    } | awk -v all="$progress_count" '
        { print }
        /^test .* \.\.\. / && all > 0 {
            share = int(20 * ++done / all)
            if (share > said) { said = share; printf "tests: %d %%, %d of %d\n", 5 * share, done, all }
        }
        { fflush() }'
    progress_rc=$(cat "$progress_status")
    rm -f "$progress_status"
    [ "$progress_rc" = 0 ] || { progress_say "some tests failed"; exit 1; }
}
